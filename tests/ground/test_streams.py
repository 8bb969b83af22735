"""Programs whose standard streams were closed before the start, as services and cron jobs are."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CLOSED = pytest.mark.parametrize("closed", ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"])

DRIVE = """
import sys
from dntorch.envs import EPuckEnv
env = EPuckEnv(render_mode="rgb_array")
env.reset(seed=1)
env.step([1.0, 1.0])
shape = env.render().shape
env.close()
with open(sys.argv[1], "w") as file:
    assert file.fileno() > 2, "what C code prints would go into it"
    print(*shape, file=file)
"""

FD = "import os, sys; sys.exit(sum(os.path.exists(f'/proc/self/fd/{k}') << k for k in range(3)))"


def run(closed: str, *arguments: object) -> subprocess.CompletedProcess:
    command = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="looks into /proc")
def test_streams_are_closed_in_these_tests() -> None:
    assert [run(c, "-c", FD).returncode for c in ("", "2>&-", "0<&- 1>&- 2>&-")] == [7, 3, 0]


@CLOSED
def test_pybullet_is_imported_and_its_world_runs(closed: str, tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    done = run(closed, "-c", DRIVE, tmp_path / "shape")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "shape").read_text() == "360 480 3\n"


@CLOSED
def test_a_command_runs(closed: str, tmp_path: Path) -> None:
    pytest.importorskip("click")
    options = ["--steps", 20, "--explore", 10, "--world", "nodes", "--out", tmp_path / "out"]
    done = run(closed, "-m", "dntorch.cli", "learn", *options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "checkpoint.pt").exists()


@CLOSED
def test_an_error_goes_to_standard_error_or_nowhere(closed: str) -> None:
    pytest.importorskip("click")
    done = run(closed, "-m", "dntorch.cli", "learn", "--steps", "few")
    assert done.returncode == 2 and done.stdout == ""
    assert ("few" in done.stderr) is ("2>&-" not in closed)


def test_ctrl_c_while_the_program_is_imported_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "click.py").write_text("raise KeyboardInterrupt\n")
    done = subprocess.run(
        [sys.executable, "-m", "dntorch", "--version"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (130, "")

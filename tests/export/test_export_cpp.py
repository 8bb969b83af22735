"""The C++ runner: builds with the libtorch of the torch wheel, and tells right from wrong."""

import fcntl
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

from dntorch.runs.config import Config
from dntorch.runs.export import export_run
from dntorch.runs.run import Trial

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(
    shutil.which("cmake") is None or shutil.which("c++") is None, reason="no C++ compiler"
)


@pytest.fixture(scope="module")
def program() -> Path:
    """Built where ``make cpp`` builds it, so that it is compiled once."""
    build = ROOT / "build" / "cpp"
    prefix = f"-DCMAKE_PREFIX_PATH={torch.utils.cmake_prefix_path}"
    build.mkdir(parents=True, exist_ok=True)
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two runs of the tests build one after the other
        for command in (["-S", ROOT / "examples" / "cpp", "-B", build, prefix], ["--build", build]):
            done = subprocess.run(["cmake", *command], capture_output=True, text=True)
            if torch.version.cuda and "PyTorch: CUDA cannot be found" in done.stderr:
                pytest.skip("a wheel of PyTorch with CUDA is linked with the CUDA toolkit")
            assert done.returncode == 0, done.stdout + done.stderr
    return build / "run_agent"


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    trial = Trial(Config(world="ring", steps=100, explore=0, seed=1))
    trial.save(folder / "checkpoint.pt")
    trial.close()
    return export_run(folder, folder / "export", ["torchscript"])


def run(program: Path, folder: Path, seconds: float = 0.1) -> subprocess.CompletedProcess:
    command = [program, folder, str(seconds)]
    return subprocess.run(command, capture_output=True, text=True, timeout=100)


def test_it_replays_the_record_and_keeps_the_rate(program, exported) -> None:
    done = run(program, exported, seconds=2)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "replay: ok" in done.stdout and "other decisions in 0 steps" in done.stdout
    for way in ("in one go: 902 steps", "loop: 64 steps at 32 Hz"):
        numbers = way + r", latency median ([\d.]+) ms, p99 ([\d.]+) ms, worst"
        median, last = map(float, re.search(numbers, done.stdout).groups())
        assert 0 < median <= last
    assert "missed deadlines" in done.stdout


def test_one_weight_changed_by_a_thousandth_fails(program, exported, tmp_path) -> None:
    shutil.copy(exported / "golden.npz", tmp_path)
    agent = torch.jit.load(exported / "agent.ts")
    agent.structure.sensorimotor.heading.kernel_0.view(-1)[5] += 1e-3
    torch.jit.save(agent, tmp_path / "agent.ts")
    done = run(program, tmp_path)
    assert done.returncode == 1 and "replay: FAILED" in done.stdout


@pytest.mark.parametrize("name", ["agent.ts", "golden.npz"])
def test_a_truncated_file_is_one_line_and_no_motion(name, program, exported, tmp_path) -> None:
    for file in ("agent.ts", "golden.npz"):
        shutil.copy(exported / file, tmp_path)
    os.truncate(tmp_path / name, (tmp_path / name).stat().st_size // 2)
    done = run(program, tmp_path)
    assert done.returncode == 1 and "loop" not in done.stdout
    assert done.stderr.startswith("run_agent: ") and done.stderr.count("\n") == 1

"""Where a package is missing: what to install, in one line, before any work."""

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from dntorch import files
from dntorch.commands import dntorch
from dntorch.extras import EXTRAS, has, require
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config

QUICK = ["--steps", "40", "--explore", "30"]
#: As after ``pip install dntorch[cli]``.
CLI_ALONE = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
from dntorch.cli import main
main()
"""


def test_the_cli_alone_trains_without_a_camera_and_writes_its_report(tmp_path: Path) -> None:
    names = {name for name, extra in EXTRAS.items() if extra != "cli"} | {"tensordict"}
    command = [sys.executable, "-c", CLI_ALONE.format(names=names), "learn", "--world", "nodes"]
    done = subprocess.run(
        [*command, *QUICK, "--out", tmp_path / "run"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").is_file()
    done = subprocess.run(
        [*command[:-1], "ring", *QUICK, "--out", tmp_path / "other"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert "dntorch[sim]" in done.stderr and "--no-video" in done.stderr
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("arguments", "package"),
    [
        ("learn --world nodes", "matplotlib"),
        ("learn --world nodes", "jinja2"),
        ("learn --world ring", "cv2"),
        ("learn --world nodes --log csv", "torchrl"),
        ("learn --world nodes --log tensorboard", "tensorboard"),
        ("reproduce", "scipy"),
        ("reproduce", "statsmodels"),
        ("reproduce --world epuck", "pybullet"),
        ("sweep --world epuck", "pybullet"),
        ("sweep --ray local", "ray"),
        ("sweep --slurm", "submitit"),
        ("export run --to new", "onnx"),
        ("export run --to new", "onnxscript"),
        ("export run --to new --also executorch", "executorch"),
        ("robot run run", "gymnasium"),
        ("robot run run --virtual", "cv2"),
        ("robot run run --film", "matplotlib"),
        ("robot run run --connect serial:///dev/ttyACM0", "serial"),
        ("robot calibrate --to new", "gymnasium"),
        ("robot calibrate --to new --virtual", "cv2"),
        ("robot calibrate --to new --connect serial:///dev/ttyACM0", "serial"),
        ("robot calibrate image.png --to new", "cv2"),
        ("view run", "bokeh"),
        ("view run", "gymnasium"),
        ("emulate", "gymnasium"),
        ("emulate", "cv2"),
        ("emulate", "tqdm"),
    ],
)
def test_a_missing_package_is_named_before_the_work(
    arguments: str, package: str, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = Config()
    content = {"config": vars(config), "agent": build_agent(config).snapshot()}
    Path("run").mkdir()
    files.save(Path("run/checkpoint.pt"), content)
    Path("image.png").write_bytes(b"")
    before = sorted(Path().rglob("*"))
    monkeypatch.setitem(sys.modules, package, None)
    done = CliRunner().invoke(dntorch, arguments.split())
    assert done.exit_code == 2, (done.output, done.exception)
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert package in done.stderr and f"pip install 'dntorch[{EXTRAS[package]}" in done.stderr
    assert sorted(Path().rglob("*")) == before


def test_what_is_there_is_not_asked_for(monkeypatch) -> None:
    require("click" if has("click") else "numpy", "numpy")
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ImportError, match=r"cv2 is not .* 'dntorch\[sim\]', or give --no-video"):
        require("numpy", "cv2", instead="give --no-video")

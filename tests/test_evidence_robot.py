"""Evidence about robots, with a tiny budget: values that were learned in simulation drive one."""

import json
import re
from pathlib import Path

import pytest
import torch
from needs import needs
from running import run

from dntorch import files
from dntorch.robot.calibration import Calibration
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """A run that knows the sequence G-B-G."""
    config = Config(world="ring", colors="GB", sequence="GBG")
    agent = build_agent(config)
    agent.weights.copy_(0.5 * (1 - torch.eye(2)))
    content = {"config": vars(config), "agent": agent.snapshot()}
    files.save(tmp_path / "checkpoint.pt", content)
    return tmp_path


def test_values_learned_in_simulation_drive_a_robot(trained: Path) -> None:
    out = trained / "transfer"
    out.mkdir()  # with a calibration, so that it need not look around first
    Calibration(fov=0.656, fps=8.0).save(out / "mild.json")
    given = ["--layouts", 1, "--cameras", "mild", "--drivers", "agent", "--processes", 1]
    printed = run("evidence/transfer.py", trained, *given, "--no-films", "--out", out)
    assert re.search(r"^mild agent 0 [\d.]+ s [GB]+ ok$", printed, re.MULTILINE), printed
    (line,) = json.loads((out / "table.json").read_text())["rows"]
    assert line["succeeded"] == [1, 1] and line["failed"] == {} and 0.2 < line["wilson"][0] < 0.21
    (out / "run.json").write_text('{"checkpoint": "that of another run"}')
    with pytest.raises(AssertionError, match="layouts of another run"):
        run("evidence/transfer.py", trained, *given, "--no-films", "--out", out)


@needs("pybullet")
def test_a_robot_beside_its_simulation_does_the_same(trained: Path) -> None:
    given = ["--layouts", 1, "--behaviors", 1]
    lines = run("evidence/robot_beside_simulation.py", trained, *given).splitlines()
    assert len(lines) == 4
    for line in lines[:3]:
        same = re.search(r"simulated ([GB]+), robot \1, at most 0 steps apart", line)
        assert same and line.endswith("wheels at most 0 rad/s apart, heading 0 degrees"), line
    assert not lines[3].endswith("heading 0 degrees"), lines[3]


def test_a_robot_stands_whatever_happens_and_moves_on_fresh_images_alone() -> None:
    events = ["HUP", "KILL", "STOP", "interpreter held up"]
    printed = run("evidence/stops.py", "--runs", 1, "--events", *events)
    rows = [line.split("|")[1:5] for line in printed.splitlines()[2:]]
    assert [name.strip() for name, *_ in rows] == ["SIGHUP", "SIGKILL", "SIGSTOP", events[-1]]
    for _, times, _, oldest in rows:
        assert float(times.split(",")[0]) < 10.0, printed  # 0.03 or 0.5, on a machine at rest
        assert oldest.strip() == "moved no more" or float(oldest) < 1.4, printed  # 2 s without care

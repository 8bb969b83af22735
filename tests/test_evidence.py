"""Recipes of evidence run with a tiny budget, and print what a reader can check."""

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


@needs("pybullet")
def test_many_seeds_ends_when_no_seed_is_left(tmp_path: Path) -> None:
    printed = run(
        "evidence/many_seeds.py", "--steps", 60, "--explore", 40, "--most", 1, "--processes", 1,
        "--out", tmp_path,
    )  # fmt: skip
    assert "1 seeds, 0 found it" in printed


def test_substeps_prints_a_line_each(tmp_path: Path) -> None:
    printed = run(
        "evidence/substeps.py", "--runs", 2, "--steps", 40, "--explore", 20, "--processes", 1,
        "--out", tmp_path,
    )  # fmt: skip
    assert re.findall(r"^(\d) sub-steps: found 0 of 2", printed, re.MULTILINE) == ["1", "2", "4"]


#: Without a compiler, which takes longer than a few plain steps.
PLAIN = {"PATH": "", "CXX": ""}


@pytest.mark.parametrize(
    ("name", "lines", "options"),
    [
        ("evidence/controls.py", 14, ""),
        ("evidence/sensitivity.py", 56, ""),
        ("evidence/reach.py", 2, "--points 0 13 --steps 500 --explore 400"),
    ],
)
def test_studies_print_a_line_a_point(name: str, lines: int, options: str, tmp_path: Path) -> None:
    budget = f"--runs 2 --steps 240 --explore 200 --processes 1 {options}".split()
    printed = run(name, *budget, "--out", tmp_path, **PLAIN)
    assert len(re.findall(r"found +\d+ +optimal", printed)) == lines
    written = tmp_path / Path(name).name
    content = json.loads(written.with_suffix(".json").read_text())
    assert content["runs"] == 2
    assert name == "evidence/controls.py" or written.with_suffix(".png").exists()


def test_fairness_prints_a_line_a_size(tmp_path: Path) -> None:
    budget = ["--sizes", "2", "4", "--steps", "400"]
    printed = run("evidence/exploration.py", *budget, "--out", tmp_path, **PLAIN)
    assert len(re.findall(r"^ +[24] behaviours: \d+", printed, re.MULTILINE)) == 2
    rows = json.loads((tmp_path / "results.json").read_text())["rows"]
    assert [row["n"] for row in rows] == [2, 4] and rows[0]["returns"] == 1
    assert 0.2 < rows[1]["returns"] < 0.45  # of 512 agents, one or two choices each


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


def test_killed_runs_go_on_and_flipped_bits_are_refused(tmp_path: Path) -> None:
    signals = "KILL", "TERM"  # tests of runs send the others
    printed = run(
        "evidence/kills.py", "--kills", 1, "--flips", 40, "--worlds", "nodes",
        "--signals", *signals, "--out", tmp_path,
    )  # fmt: skip
    for name in signals:
        assert f"nodes {name}: 1 kills, bit-identical: True" in printed
    assert "nodes: 40 bits flipped, 40 refused" in printed


@needs("pybullet")
def test_the_ring_in_torch_is_that_of_pybullet() -> None:
    printed = run("evidence/ring_against_pybullet.py", "--poses", 12)
    wrong = re.findall(r"off by more than 2, %: ([\d.e-]+)", printed)
    assert len(wrong) == 4 and max(map(float, wrong)) <= 1

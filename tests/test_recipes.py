"""Recipes run as their headers say, with a tiny budget, and print what a reader can check."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from dntorch import files
from dntorch.robot.calibration import Calibration
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config

RECIPES = Path(__file__).parents[1] / "recipes"


def run(name: str, *arguments: object, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, RECIPES / name, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=400,
        env=os.environ | {"OMP_NUM_THREADS": "1"} | environment,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_a_collector_equals_the_plain_loop_and_resumes(tmp_path: Path) -> None:
    printed = run("collector.py", "--steps", 300, "--out", tmp_path)
    assert "step 300:" in printed and "equal to the plain loop: True" in printed


@pytest.mark.parametrize("name", ["collector_sync", "collector_async", "collector_ray"])
def test_agents_in_processes_learn_and_resume_as_the_plain_loop_does(name, tmp_path: Path) -> None:
    printed = run(f"{name}.py", "--steps", 1100, "--workers", 2, "--out", tmp_path)
    for seed in (3, 4):  # which are rewarded by then
        line = rf"seed {seed}: largest value ([\d.]+), equal to the plain loop: True"
        assert float(re.search(line, printed)[1]) > 0.05, printed


def test_a_field_learns_to_remember_a_flash() -> None:
    shares = re.findall(r"(\d+)% right, peak in the dark ([\d.]+)", run("field_actor.py"))
    (before, faint), (after, held) = shares[0], shares[-1]
    assert int(before) < 70 and float(faint) < 0.1
    assert int(after) > 90 and float(held) > 0.9


def test_a_cart_calls_at_stations() -> None:
    printed = run("own_world.py", "--explore", 2000, "--exploit", 0)
    calls = list(map(int, re.findall(r"(\d+) calls", printed)))
    assert len(calls) == 1 and min(calls) > 15
    assert "values, rows" in printed


def test_the_memory_is_a_trace() -> None:
    printed = run("trace_sarsa.py", "--decisions", 400, "--seeds", 32)
    decay = float(re.search(r"tau\) = ([\d.]+)", printed)[1])
    ratios = list(map(float, re.findall(r"s: ([\d.]+)", printed)))
    assert len(ratios) == 4 and all(abs(ratio - decay) < 0.02 for ratio in ratios)
    optimal = dict(re.findall(r"^(.*?): (\d+) of 32 optimal", printed, re.MULTILINE))
    assert int(optimal["item-and-order memory"]) > 10 and int(optimal["textbook trace"]) > 10
    assert int(optimal["no trace, lambda = 0"]) == 0


def test_many_seeds_ends_when_no_seed_is_left(tmp_path: Path) -> None:
    printed = run(
        "evidence/many_seeds.py", "--steps", 60, "--explore", 40, "--most", 1, "--processes", 1,
        "--out", tmp_path,
    )  # fmt: skip
    assert "1 seeds, 0 found it" in printed


TESTED = set(re.findall(r'"(?:evidence/)?(\w+)(?:\.py)?"[,\])]', Path(__file__).read_text()))


@pytest.mark.parametrize(
    "path", [p for p in RECIPES.rglob("*.py") if p.stem in TESTED], ids=lambda p: p.stem
)
def test_a_recipe_stands_alone(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 150 and "from recipes" not in text
    assert f"python recipes/{path.relative_to(RECIPES)}" in text  # how to run it


def test_no_recipe_is_left_out() -> None:
    assert {path.stem for path in RECIPES.rglob("*.py")} <= TESTED


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


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """A run that knows the sequence G-B-G."""
    config = Config(colors="GB", sequence="GBG")
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
    printed = run(
        "evidence/kills.py", "--kills", 1, "--flips", 40, "--worlds", "nodes", "--out", tmp_path
    )
    for name in ("KILL", "TERM", "INT", "HUP"):
        assert f"nodes {name}: 1 kills, bit-identical: True" in printed
    assert "nodes: 40 bits flipped, 40 refused" in printed


def test_the_ring_in_torch_is_that_of_pybullet() -> None:
    pytest.importorskip("pybullet")
    printed = run("evidence/ring_against_pybullet.py", "--poses", 12)
    wrong = re.findall(r"off by more than 2, %: ([\d.e-]+)", printed)
    assert len(wrong) == 4 and max(map(float, wrong)) <= 1

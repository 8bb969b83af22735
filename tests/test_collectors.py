"""Recipes of TorchRL's collectors: agents in processes learn as alone."""

import re
from pathlib import Path

import pytest
from needs import needs
from running import run


@needs("pybullet")
def test_a_collector_equals_the_plain_loop_and_resumes(tmp_path: Path) -> None:
    printed = run("collector.py", "--steps", 300, "--out", tmp_path)
    assert "step 300:" in printed and "equal to the plain loop: True" in printed


#: A recipe, its world, the first of two seeds, and how many are rewarded within so many steps.
CASES = [
    pytest.param("collector_sync", "epuck", 15, 1, 640, marks=needs("pybullet")),
    ("collector_async", "ring", 64, 2, 400),
    pytest.param("collector_ray", "ring", 64, 2, 400, marks=needs("ray")),
]


@pytest.mark.parametrize(("name", "world", "first", "rewarded", "steps"), CASES)
def test_agents_in_processes_learn_and_resume_as_the_plain_loop_does(
    name: str, world: str, first: int, rewarded: int, steps: int, tmp_path: Path
) -> None:
    given = ["--world", world, "--seed", first, "--steps", steps, "--workers", 2]
    printed = run(f"{name}.py", *given, "--out", tmp_path)
    line = r"seed (\d+): largest value ([\d.]+), equal to the plain loop: True"
    learned = {int(seed): float(value) for seed, value in re.findall(line, printed)}
    assert learned.keys() == {first, first + 1}, printed
    assert sum(value > 0.05 for value in learned.values()) == rewarded, printed

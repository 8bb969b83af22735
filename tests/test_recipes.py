"""Recipes run as their headers say, with a tiny budget, and print what a reader can check."""

import re
from pathlib import Path

import pytest
from running import RECIPES, run


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


HERE = [
    Path(__file__).parent / f"{name}.py"
    for name in (
        "test_recipes",
        "test_collectors",
        "test_evidence",
        "test_evidence_robot",
        "fields/test_gallery",
    )
]
TESTED = {
    name
    for path in HERE
    for name in re.findall(r'"(?:evidence/|fields/)?(\w+)(?:\.py)?"[,\])]', path.read_text())
}


@pytest.mark.parametrize(
    "path", [p for p in RECIPES.rglob("*.py") if p.stem in TESTED], ids=lambda p: p.stem
)
def test_a_recipe_stands_alone(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 150 and "from recipes" not in text
    assert f"python recipes/{path.relative_to(RECIPES)}" in text  # how to run it


def test_no_recipe_is_left_out() -> None:
    assert {path.stem for path in RECIPES.rglob("*.py")} <= TESTED

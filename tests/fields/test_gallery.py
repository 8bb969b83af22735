"""Each program of the gallery runs as its header says, shows its phenomenon and draws a figure.

In one process: of the seconds a program takes, most are imports.
"""

import ast
import re
import runpy
import sys
from pathlib import Path

import pytest
import torch

pytest.importorskip("matplotlib")

FIELDS = Path(__file__).parents[2] / "recipes" / "fields"

#: What each prints, with a budget of its own where the one in its header is longer.
PROGRAMS = [
    ("fields/detection", r"detected at ([\d.]+), forgotten at"),
    ("fields/selection", r"one peak in 100% of the trials"),
    ("fields/memory", r"output 0\.00 at h = -6\.5, 1\.00 at h = -4\.0"),
    ("fields/travelling", r"shifted by -1\.0: -10\.2, \+0\.0: \+0\.0"),
    ("fields/a_not_b", r"the young one reaches to A, the old one to B"),
    ("fields/change", r"100% of the items are held"),
    ("fields/search", r"in 100% of \d+ scenes attention is on the one"),
    ("fields/serial_order", r"shown once: (\[.*\]); done again: \1"),
    ("fields/coordinates", r"target from the body at \[45, 45, 45\]"),
    ("fields/fit", r"error at most \d\.\de-\d+"),
    ("fields/hybrid", r"\d% of new sounds before"),
    ("fields/wolves", r"looks at \[25, 75\], binds word 4 with feature 100"),
]
BUDGETS = {
    "selection": ["--trials", "60"],
    "change": ["--trials", "24"],
    "search": ["--scenes", "6"],
}


SHARED = Path(__file__).parents[3] / "shared" / "data" / "cosivina"
WOLVES = next(iter(SHARED.glob("*wolvesPaperPR.json")), None)


@pytest.mark.parametrize("name, printed", PROGRAMS, ids=[x for x, _ in PROGRAMS])
def test_a_program_shows_its_phenomenon(
    name: str, printed: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    path = FIELDS / f"{Path(name).name}.py"
    picture = tmp_path / "figure.png"
    budget = BUDGETS.get(path.stem, [])
    if path.stem == "wolves":
        if WOLVES is None:
            pytest.skip("the third-party file wolvesPaperPR.json is not here")
        budget = [str(WOLVES)]
    monkeypatch.setattr(sys, "argv", [str(path), *budget, "--out", str(picture)])
    with torch.random.fork_rng():
        runpy.run_path(str(path), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 and re.search(printed, lines[0])
    assert 1_000 < picture.stat().st_size < 60_000


@pytest.mark.parametrize("name, most", [("visual_search", 12), ("serial_order", 25)])
def test_a_model_is_short(name: str, most: int) -> None:
    """Lines of the function that builds it, without its docstring."""
    for path in FIELDS.glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and node.name == name:
                assert node.end_lineno - node.body[1].lineno + 1 <= most
                return
    pytest.fail(f"no model {name}")


def test_no_program_is_left_out() -> None:
    assert {f"fields/{path.stem}" for path in FIELDS.glob("*.py")} == {x for x, _ in PROGRAMS}

"""docs/cosivina.md: its code runs, and its table names every class."""

import re
from pathlib import Path

from dntorch.cosivina.classes import MISSING, OUTSIDE, SUPPORTED

PAGE = (Path(__file__).parents[2] / "docs" / "cosivina.md").read_text()


def test_its_code_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    names = {}
    for block in blocks:  # from top to bottom
        exec(compile(block, "cosivina.md", "exec"), names)


def test_its_table_names_every_class_once():
    table = PAGE.split("## Elements")[1].split("## Saving")[0]
    rows = [row for row in table.splitlines() if row.startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(named) == sorted([*SUPPORTED, *OUTSIDE, *MISSING])
    missing = [row for row in rows if "**missing**" in row]
    left_out = {"History", "RunningHistory", "LFP"}
    assert {n for row in missing for n in re.findall(r"`(\w+)`", row.split("|")[1])} == (
        MISSING.keys() - left_out
    )

"""Imports point down: from commands to the ground, never up."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "dntorch"

#: Rooms from the ground up: folders, and files that have a place of their own between them. What
#: else lies in no folder is ground; `cli` and `__init__` open doors.
ROOMS = ["cells", "losses", "modules", "analysis", "plots", "cosivina", "robot", "envs", "rl",
         "export", "runs", "drive", "show", "paper", "commands"]  # fmt: skip
HIGH = {"export": ROOMS.index("rl")}  # side by side: neither knows the other


def height(module: str) -> int:
    room = module.split(".")[1] if "." in module else ""
    return HIGH.get(room, ROOMS.index(room)) if room in ROOMS else -1


def imported(path: Path) -> list[str]:
    """Modules of this package that a file imports, also within functions."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [name for name in names if name.startswith("dntorch.")]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.stem)
def test_imports_point_down(path: Path) -> None:
    own = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    if own in ("dntorch.cli", "dntorch.__init__"):
        return
    room = own.split(".")[1]
    for name in imported(path):
        same = name.split(".")[1] == room
        assert same or height(name) < max(height(own), 0), (
            f"{own} imports {name}, which lies above it"
        )

"""Sections of the agent beyond the paper: run, judged by what was predicted, on one page."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dntorch.files import write_json
from dntorch.paper.beyond import SECTIONS, Lines, Row, describe, discrete, placed, shortened
from dntorch.paper.beyond_figures import draw
from dntorch.paper.predictions import predictions
from dntorch.paper.verdict import Claim
from dntorch.process import commit
from dntorch.runs.jobs import Job, run_groups

MET, MISSED = "met", "missed"

TWINS = ("search", "recall", "change")
"""Sections with discrete SARSA(lambda) by the same rule beside each line without phases."""


def lines_of(
    section: str, seed: int, runs: int, world: str, names: list[str], steps: int | None
) -> dict[str, tuple[str, Any]]:
    """Lines of a section by name, each with the name of its part on disk.

    Raises:
        ValueError: a name that the section does not have.
    """
    lines: Lines = SECTIONS[section](seed, runs)
    for name in names:
        if name not in lines:
            raise ValueError(
                f"--lines={name!r} is not in {section}: choose from {', '.join(lines)}"
            )
    return {
        name: (f"{section}-{world}-{k}", placed(shortened(group, steps), world))
        for k, (name, group) in enumerate(lines.items())
        if not names or name in names
    }


def run_section(
    section: str,
    lines: dict[str, tuple[str, Any]],
    folder: Path,
    processes: int = 1,
    progress: Callable[[int], Any] = lambda steps: None,
) -> dict[str, Row]:
    """What the lines come to; ``SECTION.json`` and a figure are written."""
    jobs = [Job(part, group) for part, group in lines.values()]
    events = run_groups(jobs, folder / "parts", processes, progress, batches=1)
    rows = {name: describe(group, events[part]) for name, (part, group) in lines.items()}
    for name, (_, group) in lines.items():
        if section in TWINS and group.config.explore == group.config.steps:
            rows[name]["discrete"] = discrete(group, rows[name])
    group = next(iter(lines.values()))[1]
    name = section if group.config.world == "nodes" else f"{section}-{group.config.world}"
    about = {"section": section, "world": group.config.world, "seed": group.config.seed}
    content = about | {"runs": group.batch[0], "commit": commit(), "lines": rows}
    write_json(folder / f"{name}.json", content)
    draw(section, rows).savefig(folder / f"{name}.png", dpi=100, facecolor="white")
    return rows


# ------------------------------------------------------------------ predictions

#: What is predicted, how it is said, and what of a line it is about.
QUANTITIES = {
    "optimal": ("optimal at the end", lambda row: row["optimal"][0] / row["optimal"][1]),
    "rewards": ("rewards of a run", lambda row: row["rewards"]),
    "to_first": ("behaviours to the first reward", lambda row: row["to_first"]),
    "within_300": ("found within 300", lambda row: row["within_300"][0] / row["within_300"][1]),
    "to_relearn": ("median of behaviours to re-learn", lambda row: row["to_relearn"]),
    "stuck": ("stuck runs", lambda row: row["stuck"]),
    "failures": ("failures of a run", lambda row: row["failures"]),
    "minutes_to_first": ("minutes to the first reward", lambda row: row["minutes_to_first"]),
}  # fmt: skip


#: Later predictions, and how they are called beside the first.
REVISIONS = {"revised": ", revised", "again": ""}


def judge(section: str, rows: dict[str, Row]) -> list[Claim]:
    """Each number that was predicted beside the one that was found."""
    beyond = predictions("beyond")
    expected = [(beyond[section], "")]
    for times, when in REVISIONS.items():
        expected.append((beyond[times].get(section, {}), when))
    claims = []
    for lines, when in expected:
        for name, line in lines.items():
            for key, bound in line.items() if name in rows else ():
                quantity, _, side = key.rpartition("_at_")
                if quantity in QUANTITIES:
                    claims.append(_claim(name + when, quantity, side, bound, rows[name]))
    return claims


def _claim(name: str, quantity: str, side: str, bound: float, row: Row) -> Claim:
    words, number = QUANTITIES[quantity]
    found = number(row)
    holds = found is not None and (found >= bound if side == "least" else found <= bound)
    shown = "none" if found is None else f"{found:.3g}"
    if interval := row.get(f"{quantity}_interval"):
        shown += f" [{interval[0]:.3g}, {interval[1]:.3g}]"
    shown += f", {row['runs']} runs"
    return Claim(name, f"{words}, at {side} {bound:g}", shown, MET if holds else MISSED)


# ------------------------------------------------------------------ the page


def write_page(folder: Path, command: str) -> Path:
    """``report.html``: all sections that were run in a folder."""
    from jinja2 import Environment, PackageLoader

    parts = []
    for path in sorted(folder.glob("*.json")):
        part = json.loads(path.read_text(encoding="utf-8"))
        part["claims"], part["figure"] = judge(part["section"], part["lines"]), path.stem
        parts.append(part)
    environment = Environment(loader=PackageLoader("dntorch", "paper"), autoescape=True)
    page = environment.get_template("beyond.html").render(
        parts=parts, command=command, colors={MET: "yes", MISSED: "no"}
    )
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path

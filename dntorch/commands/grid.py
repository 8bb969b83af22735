"""Options that say which runs make a sweep: seeds, and values to combine."""

import re
from typing import Any

import click

from dntorch.commands.common import MOST_RUNS
from dntorch.commands.kinds import Parsed, once
from dntorch.commands.options import kind_of
from dntorch.runs.config import FIELDS


def _seeds(text: str) -> list[int]:
    seeds: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"([0-9]{1,20})(?:-([0-9]{1,20}))?", part)
        if ends is None:
            raise ValueError("give numbers such as 0-9 or 1,5,7")
        numbers = range(int(ends[1]), int(ends[2] or ends[1]) + 1)
        if not numbers:
            raise ValueError(f"{part} names none: give the smaller number first")
        if numbers[-1] not in FIELDS["seed"].metadata["within"]:
            raise ValueError(f"give seeds up to {FIELDS['seed'].metadata['within'].most:,}")
        if len(seeds) + len(numbers) > MOST_RUNS:
            raise ValueError(f"give at most {MOST_RUNS:,} of them")
        seeds += numbers
    return seeds


def _setting(text: str) -> tuple[str, list[Any]]:
    name, _, values = text.partition("=")
    if name not in FIELDS or name == "seed":
        known = ", ".join(sorted(FIELDS.keys() - {"seed"}))
        raise ValueError(f"{name!r} cannot be set: choose from {known}")
    kind = kind_of(FIELDS[name])
    return name, [_value(kind, value, FIELDS[name].default) for value in values.split(",")]


def _value(kind: click.ParamType, text: str, default: Any) -> Any:
    if isinstance(kind, click.Choice):
        if text not in kind.choices:
            raise ValueError(f"choose from {', '.join(kind.choices)}")
        return text
    try:
        return kind.read(text)
    except ValueError as error:
        raise ValueError(f"{error}, such as {default}") from error


def _varied(_: click.Context, __: click.Parameter, given: tuple[tuple[str, Any], ...]) -> Any:
    """Lists of values by name, each named once."""
    once(given, "--set", "give NAME=VALUE,VALUE")
    return dict(given)


SEEDS = click.option(
    "--seeds",
    type=Parsed(_seeds),
    default="0-9",
    show_default=True,
    help="Such as 0-99 or 1,5,7.",
)
SET = click.option(
    "--set",
    "settings",
    multiple=True,
    type=Parsed(_setting),
    callback=_varied,
    metavar="NAME=VALUE[,VALUE...]",
    help="A value of the run, or several to combine: learning_rate=0.03,0.06.",
)

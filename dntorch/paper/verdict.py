"""What a claim is, and what may become of it."""

from typing import Any, NamedTuple

from dntorch.paper.statistics import wilson

YES, NO, UNTESTABLE = "reproduced", "not reproduced", "not testable"


class Claim(NamedTuple):
    """One sentence and what became of it."""

    sentence: str
    form: str
    """what is measured, and the margin set before the runs"""
    number: str
    verdict: str


def verdict(holds: bool, decidable: bool = True) -> str:
    return (YES if holds else NO) if decidable else UNTESTABLE


def share(entry: dict[str, Any], key: str) -> str:
    """``k of n = p [low, high]``"""
    k, n = entry[key]
    low, high = wilson(k, n)
    return f"{k} of {n} = {k / n:.3f} [{low:.3f}, {high:.3f}]" if n else "no run"

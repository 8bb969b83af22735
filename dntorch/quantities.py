"""Sentences about plain numbers with a unit; `dntorch.checks` has those about tensors."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any


def check_quantities(**quantities: float) -> None:
    """Raise a ``ValueError`` that names the first quantity that is not positive and finite.

    >>> check_quantities(axle=0.052, dt=1 / 32)
    """
    for name, value in quantities.items():
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not (number and 0 < value <= sys.float_info.max):
            raise ValueError(
                f"{name}={shown(value)} is not positive and finite: give a number above 0"
            )


def check_vector(name: str, value: Any, within: "Interval") -> None:
    """Raise a ``ValueError`` unless ``value`` is three numbers."""
    three = isinstance(value, Sequence) and len(value) == 3
    if not three or any(number not in within for number in value):
        raise ValueError(f"{name}={shown(value)}: give {within}, three times")


def check_kind(name: str, value: Any, kind: type) -> None:
    """Raise a ``ValueError`` unless ``value`` is an object of this class, which tells how."""
    if not isinstance(value, kind):
        raise ValueError(f"{name}={shown(value)} is no {name}: give {kind.__name__}(...)")


@dataclass(frozen=True)
class Interval:
    """Numbers that make sense: from ``least`` to ``most``, and finite.

    >>> Interval(0, 10, above=True, unit="m").check("axle", 0.05)
    >>> print(Interval(1, 20_000, whole=True))
    a whole number from 1 to 20,000
    """

    least: float
    most: float
    whole: bool = False
    above: bool = False
    """``least`` itself is none of them"""
    unit: str = ""

    def __contains__(self, value: Any) -> bool:
        kind = Integral if self.whole else Real
        if isinstance(value, bool) or not isinstance(value, kind):
            return False
        return self.least <= value <= self.most and not (self.above and value == self.least)

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        low, high = f"{self.least:,}", f"{self.most:,}{self.unit and ' ' + self.unit}"
        if self.above:
            return f"{kind} above {low}, at most {high}"
        return f"{kind} from {low} to {high}"

    def check(self, name: str, value: Any) -> None:
        """Raise a ``ValueError`` that names the argument unless ``value`` is one of them."""
        if value not in self:
            raise ValueError(f"{name}={shown(value)}: give {self}")


def shown(value: Any, longest: int = 60) -> str:
    """A value for a sentence, cut where it would fill the screen.

    >>> print(shown(0.5), shown("a"), shown(10**100, longest=5))
    0.5 'a' 10000...
    """
    try:
        text = repr(value)
    except ValueError:  # whole numbers of more than 4300 digits
        return "a number too large to print"
    return text if len(text) <= longest else text[:longest] + "..."


def per_second(dt: float) -> float:
    """How many steps of ``dt`` seconds are in a second, as a whole number where it is one.

    >>> per_second(1 / 32), per_second(0.1), per_second(0.15)
    (32, 10, 6.666666666666667)
    """
    rate = 1 / dt
    return round(rate) if math.isclose(rate, round(rate), rel_tol=1e-9) else rate

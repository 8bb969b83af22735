"""Links: what one element of an architecture gives to another."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dntorch.cells.kernels import Kernel
from dntorch.checks import shown
from dntorch.modules.elements import Arm
from dntorch.modules.projection import Projection


class Link(NamedTuple):
    """What one element of an architecture gives to another; see `Projection` for the last four.

    ``Link("a", "b", kernel=2.0)``, or the plain tuple ``("a", "b", 2.0)``.
    """

    source: str
    target: str
    axes: Any = None
    """A pattern; None for the same axes; or a `Projection`, which says all."""
    kernel: float | Tensor | Kernel = 1.0
    border: str | Sequence[str] = "circular"
    reduce: str = "sum"


class Coupling(NamedTuple):
    """A link as it was built."""

    source: str
    target: str
    projection: Projection
    """Its ``kernel`` can be set."""


def as_link(link: Any) -> Link:
    """A link from a plain tuple; or raise."""
    if isinstance(link, Link):
        return link
    if not isinstance(link, tuple) or not 2 <= len(link) <= len(Link._fields):
        raise ValueError(
            f"link {shown(link)}: give (source, target, axes, kernel, border, reduce), each "
            "link an argument of its own"
        )
    if len(link) == 3 and not isinstance(link[2], (str, Projection, type(None))):
        return Link(link[0], link[1], None, link[2])
    return Link(*link)


def check_ends_of(link: Link, sources: Iterable[str], targets: Iterable[str]) -> None:
    """Raise unless both ends of a link are there."""
    for role, label, known in (
        ("source", link.source, sources),
        ("target", link.target, targets),
    ):
        if not isinstance(label, str) or label not in known:
            raise ValueError(
                f"link {_told(link)}: {role} {label!r} is not there: choose from {list(known)}"
            )


def projection_of(
    link: Link, source: list[int], target: list[int], dtype: torch.dtype
) -> Projection:
    """The projection of a link between two shapes; or raise."""
    projection = link.axes
    try:
        if projection is None:
            if source != target and isinstance(link.kernel, (int, float, Tensor)):
                raise ValueError(
                    f"shapes {source} and {target} differ: name the axes, such as 'y x -> x'"
                )
            names = " ".join(f"a{k}" for k in range(len(target)))
            projection = f"{names} -> {names}"
        if isinstance(projection, str):
            how = {"border": link.border, "reduce": link.reduce, "dtype": dtype}
            projection = Projection(projection, source, target, link.kernel, **how)
        if not isinstance(projection, Projection):
            raise TypeError(f"axes={shown(projection)} is no pattern: give one such as 'y x -> x'")
    except (ValueError, TypeError) as error:
        raise type(error)(f"link {_told(link)}: {error}") from error
    if [projection.source, projection.target] != [source, target]:
        raise ValueError(
            f"link {_told(link)}: the projection leads from {projection.source} to "
            f"{projection.target}, the elements have {source} and {target}: build one for them"
        )
    return projection


def rank(arm: Arm) -> tuple[str, ...]:
    """By which links into one element are sorted: none is before another by chance."""
    p = arm.projection
    return arm.source, p.axes, p.reduce, repr(p.border), repr(p._terms)


def _told(link: Link) -> str:
    return f"({shown(link.source)}, {shown(link.target)})"

"""Axes of a projection by name: which go through, which are reduced, which are new.

A pattern such as ``"y x -> x"`` is read once; `Route` is what is left of it: plain numbers of
axes, counted from the end, since a batch of any form stands before them.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

REDUCTIONS = ("sum", "mean", "max", "min")


class Route(NamedTuple):
    """From the axes of a source to those of a target, over the axes that go through."""

    through: list[str]
    """Names of the axes that go through, in the order in which they reach the target."""
    shear: list[int]
    """Two axes that become their diagonals, one axis ``r+g``; empty for none."""
    reduced: list[int]
    """Axes that are reduced, after that."""
    order: list[int]
    """Of the axes that are left: where each of those that go through comes from."""
    unshear: list[int]
    """The axis ``r+g`` that becomes two, and the size of the second; empty for none."""
    placed: list[int]
    """Where each axis stands in the target."""
    new: list[int]
    """Axes of the target along which all is the same."""
    middle_from: list[int]
    """Sizes of the axes that go through, as they come from the source."""
    middle_to: list[int]
    """The same, as they go into the target."""


def read_pattern(axes: str, source: list[int], target: list[int]) -> Route:
    """The route of a pattern between two shapes.

    Raises:
        ValueError: what is no pattern, names that repeat, sizes that do not fit.
    """
    came, goes = _names(axes, source, target)
    given, wanted = dict(zip(came, source)), dict(zip(goes, target))
    sums_in = [name for name in goes if "+" in name and name not in came]
    sums_out = [name for name in came if "+" in name and name not in goes]
    if len(sums_in) + len(sums_out) > 1:
        raise ValueError(f"axes={axes!r} has more than one diagonal: chain two projections")
    shear: list[int] = []
    unshear: list[int] = []
    starts, ends = came, goes  # with a diagonal for its two axes
    for name in sums_in:
        pair = _pair(axes, name, given, wanted)
        shear = [_place(came, part) for part in pair]
        starts = [*(n for n in came if n not in pair), name]
    for name in sums_out:
        first, second = _pair(axes, name, wanted, given)
        ends = [name if n == first else n for n in goes if n != second]
    through = [name for name in ends if name in starts]
    reduced = [_place(starts, n) for n in starts if n not in through]
    left = [n for n in starts if n in through]
    order = [_place(left, n) for n in through]
    laid = through
    for name in sums_out:
        first, second = name.split("+")
        unshear = [_place(through, name), wanted[second]]
        laid = [*(first if n == name else n for n in through), second]
    standing = [n for n in goes if n in laid]
    placed = [_place(standing, n) for n in laid]
    new = [_place(goes, n) for n in goes if n not in laid]
    middle = [given[n] for n in through], [wanted[n] for n in through]
    return Route(through, shear, reduced, order, unshear, placed, new, *middle)


def _place(names: list[str], name: str) -> int:
    """Where an axis stands, counted from the end."""
    return names.index(name) - len(names)


def _names(axes: str, source: list[int], target: list[int]) -> tuple[list[str], list[str]]:
    sides = axes.split("->") if isinstance(axes, str) else []
    if len(sides) != 2:
        raise ValueError(f"axes={axes!r} is no pattern: give one such as 'y x -> x'")
    names = [side.split() for side in sides]
    for side, shape, role in zip(names, (source, target), ("source", "target")):
        parts = [part for name in side for part in name.split("+")]
        if not all(part.isidentifier() for part in parts) or len(set(parts)) < len(parts):
            raise ValueError(
                f"axes={axes!r}: give each axis of one side a name of its own, such as 'y x -> x'"
            )
        if any(name.count("+") > 1 for name in side):
            raise ValueError(f"axes={axes!r}: a diagonal is of two axes, such as 'r g -> r+g'")
        if len(side) != len(shape):
            raise ValueError(
                f"axes={axes!r} names {len(side)} axes of the {role}, which has shape {shape}: "
                "name each"
            )
    return names[0], names[1]


def _pair(axes: str, name: str, parts: dict[str, int], sums: dict[str, int]) -> list[str]:
    """The two axes of a diagonal ``name``, whose size it has on their side from now on."""
    pair = name.split("+")
    if not all(part in parts for part in pair):
        raise ValueError(f"axes={axes!r}: the parts of {name} must stand on the other side")
    first, second = (parts[part] for part in pair)
    parts[name] = first + second - 1
    if sums[name] != parts[name]:
        raise ValueError(
            f"axes={axes!r}: {name} of {sums[name]} sites does not fit {first} and {second}: give "
            f"{parts[name]}"
        )
    return pair


def shear(x: Tensor, fill: float) -> Tensor:
    """``(*, r, g)`` laid along its diagonals: ``(*, r, r+g)``, with ``fill`` where nothing is."""
    rows, columns = x.shape[-2], x.shape[-1]
    batch = list(x.shape[:-2])
    wide = torch.nn.functional.pad(x, [0, rows], value=fill)
    flat = wide.reshape(batch + [rows * (rows + columns)])
    flat = flat.narrow(-1, 0, rows * (rows + columns - 1))
    return flat.reshape(batch + [rows, rows + columns - 1])


def reduced(x: Tensor, dims: list[int], how: str) -> Tensor:
    """A tensor without the axes ``dims``."""
    if len(dims) == 0:
        return x
    if how == "sum":
        return x.sum(dims)
    if how == "mean":
        return x.mean(dims)
    return x.amax(dims) if how == "max" else x.amin(dims)


def diagonals(x: Tensor, dims: list[int], how: str) -> Tensor:
    """Two axes become one, the last, over their diagonals: ``out[k]`` of all ``r + g = k``."""
    x = x.movedim(dims, [-2, -1])
    if how == "max" or how == "min":
        sheared = shear(x, -math.inf if how == "max" else math.inf)
        return sheared.amax(-2) if how == "max" else sheared.amin(-2)
    total = shear(x, 0.0).sum(-2)
    if how == "mean":
        ones = torch.ones(x.shape[-2:], dtype=x.dtype, device=x.device)
        return total / shear(ones, 0.0).sum(-2)
    return total

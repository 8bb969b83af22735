"""Reading a field: where its peaks are, how wide, how many. Positions count from 0."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.kernels import per_axis


def center_of_mass(output: Tensor, border: str = "zero") -> Tensor:
    r"""Mean position along the last axis, weighted by output: ``(*batch, n)`` to ``(*batch)``.

    On a ``circular`` axis the direction of the vector sum :math:`\sum_x f_x e^{2 \pi i x/n}`,
    in ``[0, n)``. NaN where the output is zero everywhere.

    >>> center_of_mass(torch.tensor([3.0, 0.0, 0.0, 0.0, 0.0, 3.0]), "circular")
    tensor(5.5000)
    """
    n = output.shape[-1]
    site = torch.arange(n, dtype=output.dtype, device=output.device)
    total = output.sum(-1)
    if border == "zero":
        return (output * site).sum(-1) / total
    if border != "circular":
        raise ValueError(f"border={border} is unknown: choose 'circular' or 'zero'")
    angle = 2 * math.pi / n * site
    mean = torch.atan2((output * angle.sin()).sum(-1), (output * angle.cos()).sum(-1))
    return (mean * n / (2 * math.pi)) % n + 0 * total / total


class Peak(NamedTuple):
    """A connected region of a field that is on."""

    center: tuple[float, ...]
    """Its centre of mass, in sites, one an axis."""
    width: tuple[int, ...]
    """Sites it covers, one an axis."""


def peaks(output: Tensor, border: str | Sequence[str] = "zero", level: float = 0.5) -> list[Peak]:
    """Peaks of one field, no batch, of any number of axes: connected regions above ``level``.

    Sites connect along the axes, not across corners. In the order of their last sites. Eager
    only, since the number depends on data.

    >>> peaks(torch.tensor([1.0, 0.0, 0.9, 0.9, 0.0, 1.0]), "circular")
    [Peak(center=(2.5,), width=(2,)), Peak(center=(5.5,), width=(2,))]
    """
    borders = per_axis("border", border, output.dim())
    on = output > level
    label = torch.arange(1, on.numel() + 1, device=on.device).view(on.shape) * on
    while not torch.equal(label, grown := _spread(label, borders) * on):
        label = grown
    return [_measure(output, label == last, borders) for last in label[on].unique()]


def _spread(label: Tensor, borders: Sequence[str]) -> Tensor:
    """Largest label among each site and its neighbours."""
    for axis, border in enumerate(borders):
        left, right = label.roll(1, axis), label.roll(-1, axis)
        if border == "zero":
            left.narrow(axis, 0, 1).zero_()
            right.narrow(axis, -1, 1).zero_()
        label = torch.stack((label, left, right)).amax(0)
    return label


def _measure(output: Tensor, region: Tensor, borders: Sequence[str]) -> Peak:
    center, width = [], []
    for axis, (n, border) in enumerate(zip(region.shape, borders, strict=True)):
        line = (output * region).movedim(axis, -1).reshape(-1, n).sum(0)
        center.append(center_of_mass(line, border).item())
        width.append(int(region.movedim(axis, -1).reshape(-1, n).any(0).sum()))
    return Peak(tuple(center), tuple(width))

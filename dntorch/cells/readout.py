"""Reading a field: where its peaks are, how wide, how heavy, how many. Positions count from 0.

One word for ``border`` is that of a line, ``(*batch, n)``; a tuple has one word per axis, and as
many trailing dimensions are the field: ``("circular", "zero")`` reads sheets ``(*batch, y, x)``.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.checks import check_finite_number, check_no_nan, check_real, shown

Border = str | Sequence[str]


class Peaks(NamedTuple):
    """The peaks of each field of a batch. Entries from ``count`` on are padding."""

    count: Tensor
    """How many, ``(*batch,)``, whole numbers."""
    center: Tensor
    """Their centres of mass in sites, ``(*batch, most, axes)``; padding is NaN."""
    mass: Tensor
    """Sum over a peak of what exceeds the threshold, ``(*batch, most)``; padding is 0."""
    width: Tensor
    """Sites it covers along each axis, ``(*batch, most, axes)``; padding is 0."""


def peaks(u: Tensor, threshold: float = 0.0, border: Border = "circular") -> Peaks:
    r"""Peaks of fields: connected regions in which ``u`` is above ``threshold``.

    .. math:: m = \sum_{x \in \text{peak}} (u(x) - \mu), \qquad
              c = \frac1m \sum_{x \in \text{peak}} (u(x) - \mu)\, x

    and on a circular axis the direction of the vector sum, as in `center_of_mass`.

    =============  ====  ==========================================================
    argument       unit  meaning
    =============  ====  ==========================================================
    ``u``          1     activation; or an output, with ``threshold=0.5``
    ``threshold``  1     a site is *on* above it
    ``border``     --    "circular" or "zero"; a tuple has one per axis of the field
    =============  ====  ==========================================================

    Shapes: ``u`` is ``(*batch, *shape)``, of as many axes as ``border`` has words; one word is a
    line. Fields have different numbers of peaks: results are padded to ``most``, the largest
    number in the batch; those of one field are ``found.center[k, : found.count[k]]``.

    Sites connect along the axes, not across corners, and over circular borders. Peaks come in the
    order of their last sites. ``mass`` and ``center`` are differentiable in ``u`` while no site
    crosses the threshold. Weights are what exceeds the threshold, so both stay continuous when
    one does. A region that goes all around a ring evenly has no centre there: NaN.

    Eager only, since the number depends on data. As many passes as the regions need, about the
    logarithm of their size for convex ones.

    Raises:
        TypeError: ``u`` is no tensor of floats.
        ValueError: NaN in ``u``, fewer dimensions than words, an unknown border.

    >>> found = peaks(torch.tensor([2.0, -5.0, 1.0, 1.0, -5.0, 2.0]))
    >>> found.count, found.center.squeeze(-1), found.mass
    (tensor(2), tensor([2.5000, 5.5000]), tensor([2., 4.]))
    """
    borders, shape = field_of("u", u, border)
    check_finite_number("threshold", threshold)
    check_no_nan("u", u)
    batch, sites = u.shape[: u.dim() - len(shape)], math.prod(shape)
    flat = u.reshape(math.prod(batch), sites)
    on = flat > threshold
    label = _regions(on.view(-1, *shape), borders).view(on.shape)
    last = label == torch.arange(1, sites + 1, device=u.device)
    order = last.cumsum(-1) * last  # 1, 2, … at the last site of each region
    number = order.gather(-1, (label - 1).clamp_min(0)) * on
    count = last.sum(-1)
    most = int(count.amax()) if count.numel() else 0
    weight = torch.where(on, flat - threshold, 0)
    mass, center, width = _sum(weight, number, most), [], []
    places = torch.unravel_index(torch.arange(sites, device=u.device), shape)
    for n, word, site in zip(shape, borders, places, strict=True):
        waves = [_sum(weight * wave[site], number, most) for wave in _waves(n, word, u)]
        center.append(_position(torch.stack(waves), mass, n, word))
        width.append(_covered(site.expand_as(number), number, most, n))
    return Peaks(
        count.view(batch),
        torch.stack(center, -1).view(*batch, most, len(shape)),
        mass.view(*batch, most),
        torch.stack(width, -1).view(*batch, most, len(shape)),
    )


def center_of_mass(output: Tensor, border: str = "zero") -> Tensor:
    r"""Mean position along the last axis, weighted by output: ``(*batch, n)`` to ``(*batch)``.

    On a ``circular`` axis the direction of the vector sum :math:`\sum_x f_x e^{2 \pi i x/n}`,
    in ``[0, n)``. NaN where the output is zero everywhere, or balanced around the ring; the
    gradient is zero there.

    >>> center_of_mass(torch.tensor([3.0, 0.0, 0.0, 0.0, 0.0, 3.0]), "circular")
    tensor(5.5000)
    """
    _, (n,) = field_of("output", output, border if isinstance(border, str) else (border,))
    waves = torch.stack([(output * wave).sum(-1) for wave in _waves(n, border, output)])
    return _position(waves, output.sum(-1), n, border)


def field_of(name: str, field: Tensor, border: Border) -> tuple[tuple[str, ...], list[int]]:
    """The borders and the shape of the fields in ``(*batch, *shape)``; or raise."""
    borders = words(border)
    check_real(name, field)
    if field.dim() < len(borders) or 0 in field.shape[field.dim() - len(borders) :]:
        raise ValueError(
            f"{name} of shape {list(field.shape)} is no field of {len(borders)} axes: give "
            f"(*batch, *shape), or another border than {border!r}, which has a word per axis"
        )
    return borders, list(field.shape[field.dim() - len(borders) :])


def words(border: Border) -> tuple[str, ...]:
    """One border per axis; one word alone is that of a line."""
    several = isinstance(border, Sequence)
    borders = (border,) if isinstance(border, str) or not several else tuple(border)
    for word in borders:
        if not isinstance(word, str) or word not in ("circular", "zero"):
            raise ValueError(f"border={shown(word)} is unknown: choose 'circular' or 'zero'")
    if not borders:
        raise ValueError("border=() has no axis: give a word per axis, such as 'circular'")
    return borders


def _waves(n: int, border: str, like: Tensor) -> list[Tensor]:
    """What is summed to find a position along an axis: sites, or cosine and sine."""
    (word,) = words(border)
    site = torch.arange(n, dtype=like.dtype, device=like.device)
    angle = 2 * math.pi / n * site
    return [site] if word == "zero" else [angle.cos(), angle.sin()]


def _position(sums: Tensor, total: Tensor, n: int, border: str) -> Tensor:
    """Position from sums over `_waves`; NaN where there is none, with a gradient of zero."""
    if border == "zero":
        there = total > 0
        position = sums[0] / torch.where(there, total, 1)
    else:
        length = sums.detach().square().sum(0).sqrt()
        there = (total > 0) & (length > torch.finfo(sums.dtype).eps ** 0.5 * total)
        angle = torch.atan2(torch.where(there, sums[1], 0), torch.where(there, sums[0], 1))
        position = angle * n / (2 * math.pi) % n
        position = torch.where(position < n, position, 0)  # rounded up to n
    return torch.where(there, position, math.nan)


def _regions(on: Tensor, borders: Sequence[str]) -> Tensor:
    """For each site that is on the number of its region's last site, from 1; else 0."""
    sites = math.prod(on.shape[1:])
    label = torch.arange(1, sites + 1, device=on.device).view(1, *on.shape[1:]) * on
    while True:
        grown = (_spread(label, borders) * on).flatten(1)
        # The site that a label names may know of one that lies farther in the same region.
        grown = torch.maximum(grown, grown.gather(-1, (grown - 1).clamp_min(0)))
        grown = grown.view(on.shape) * on
        if torch.equal(label, grown):
            return label
        label = grown


def _spread(label: Tensor, borders: Sequence[str]) -> Tensor:
    """Largest label among each site and its neighbours along the axes."""
    largest = label
    for axis, border in enumerate(borders, start=1):
        left, right = label.roll(1, axis), label.roll(-1, axis)
        if border == "zero":
            left.narrow(axis, 0, 1).zero_()
            right.narrow(axis, -1, 1).zero_()
        largest = torch.maximum(largest, torch.maximum(left, right))
    return largest


def _sum(weight: Tensor, number: Tensor, most: int) -> Tensor:
    """Sums of ``(rows, sites)`` over the regions 1 to ``most``, ``(rows, most)``."""
    return weight.new_zeros(len(weight), most + 1).scatter_add(1, number, weight)[:, 1:]


def _covered(site: Tensor, number: Tensor, most: int, n: int) -> Tensor:
    """How many of ``n`` positions along an axis each region covers, ``(rows, most)``."""
    covered = number.new_zeros(len(number), (most + 1) * n)
    covered = covered.scatter(1, number * n + site, 1)
    return covered.view(-1, most + 1, n).sum(-1)[:, 1:]

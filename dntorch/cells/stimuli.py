"""Stimuli: inputs with the form of a peak."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.kernels import borders_of, per_axis, sites
from dntorch.checks import LARGEST, count, shown
from dntorch.number import Number


def gauss(
    shape: int | Sequence[int],
    position: Number | Sequence[Number],
    sigma: Number | Sequence[Number],
    amplitude: Number = 1.0,
    border: str | Sequence[str] = "circular",
) -> Tensor:
    r"""A Gaussian over the sites of a field, ``(*batch, *shape)``.

    .. math:: S(x) = a \prod_k \exp\left(-\frac{(x_k - p_k)^2}{2 \sigma_k^2}\right)

    On an axis with a circular border the distance is the shortest one around the ring.

    Args:
        shape: of the field, an int for one axis.
        position: of the middle in sites, counted from 0; one number per axis.
        sigma: width in sites, one for all axes or one per axis.
        amplitude: height of the middle.
        border: ``"circular"`` or ``"zero"``, one for all axes or one per axis.

    Each number may be a tensor ``(*batch,)``: these shapes are broadcast. Differentiable in them.

    Raises:
        ValueError: ``sigma`` not positive, an unknown border, numbers that are not one per axis.

    >>> gauss(5, 1.0, 1.0, 2.0).round(decimals=2)
    tensor([1.2100, 2.0000, 1.2100, 0.2700, 0.2700])
    """
    sizes = sites(shape)
    axes, borders = len(sizes), borders_of(border, len(sizes))
    if axes == 0:
        raise ValueError("shape=() is a node: its stimulus is a number")
    numbers = [amplitude, *per_axis("position", position, axes), *per_axis("sigma", sigma, axes)]
    for name, number in zip(["amplitude"] + ["position"] * axes + ["sigma"] * axes, numbers):
        _check_number(name, number)
    shapes = [x.shape for x in numbers if isinstance(x, Tensor)]
    try:
        torch.broadcast_shapes(*shapes)
    except RuntimeError:
        raise ValueError(
            f"position, sigma and amplitude have batches {[list(x) for x in shapes]}, which do not "
            "fit each other: give all the same, or one number"
        ) from None
    given = [x for x in numbers if isinstance(x, Tensor) and x.is_floating_point()]
    total = amplitude if isinstance(amplitude, Tensor) else torch.tensor(float(amplitude))
    total = total.to(given[0]) if given else total.to(torch.get_default_dtype())
    total = total.reshape(list(total.shape) + [1] * axes)
    each = zip(sizes, numbers[1 : 1 + axes], numbers[1 + axes :], borders)
    for axis, (n, middle, width, edge) in enumerate(each):
        site = torch.arange(n, dtype=total.dtype, device=total.device)
        site = site.reshape([n] + [1] * (axes - 1 - axis))
        distance = site - _column(middle, axes)
        if edge == "circular":
            distance = (distance + n / 2) % n - n / 2
        total = total * torch.exp(-0.5 * (distance / _column(width, axes)) ** 2)
    return total


def _check_number(name: str, number: Number) -> None:
    if isinstance(number, Tensor):
        if number.is_complex() or number.dtype == torch.bool:
            raise ValueError(f"{name} of dtype {number.dtype} is no number: give floats")
        finite, positive = not count(~number.isfinite()), not count(~(number > 0))
    else:
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ValueError(
                f"{name}={shown(number)} is no number: give a float, or a tensor (*batch,)"
            )
        finite, positive = abs(number) <= LARGEST, number > 0
    if not finite:
        raise ValueError(f"{name}={shown(number)} is not finite: give numbers")
    if name == "sigma" and not positive:
        raise ValueError(f"sigma={shown(number)} must be positive: give a width in sites")


def _column(number: Number, axes: int) -> Number:
    """One number per member of a batch, with as many axes as a field has."""
    if isinstance(number, Tensor):
        return number.reshape(list(number.shape) + [1] * axes)
    return number

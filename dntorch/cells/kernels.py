r"""Kernels of lateral interaction: a sum of terms, each a product of one matrix an axis.

.. math:: \omega(x, x') = c_g + \sum_r \prod_a K_r^{(a)}(x_a, x'_a)

A kernel is a sequence of terms, in any order: `Gauss` (two of them make a difference of
Gaussians), `Global`, and `Matrices` for all that is neither. Amplitudes are signed: negative
ones inhibit. Distances are in sites, positions start at 0.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor


class Gauss(NamedTuple):
    """A Gaussian that falls with the distance between two sites."""

    amplitude: float
    """Sum over all taps if ``normalized``, else height of the middle."""
    sigma: float | tuple[float, ...]
    """Standard deviation in sites, one for all axes or one an axis."""
    shift: float | tuple[float, ...] = 0.0
    """Sites by which the effect lies to the right of its cause; moves peaks."""
    cutoff: float = 5.0
    """Half width in sigmas. (cedar's "limit" is the whole width.)"""
    normalized: bool = True
    """Divide by the sum over the taps kept."""


class Global(NamedTuple):
    """The same effect of every site on every site: a sum over the field."""

    amplitude: float


class Matrices(NamedTuple):
    """A product of given matrices, one an axis, ``matrix[to, from]``."""

    matrices: tuple[Tensor, ...]


Kernel = Sequence[Gauss | Global | Matrices]

SELECTIVE: Kernel = (Gauss(20.0, 3.0), Global(-1.0))
"""Decides between two inputs, and lets go of the winner when its input goes."""


def gauss_matrix(
    n: int,
    sigma: float,
    border: str = "circular",
    shift: float = 0.0,
    cutoff: float = 5.0,
    normalized: bool = True,
) -> Tensor:
    r"""Matrix of a Gaussian along one axis, ``(n, n)`` in float64, ``matrix[to, from]``.

    .. math:: K(x, x') = \exp\left(-\frac{(x - x' - s)^2}{2 \sigma^2}\right)
              \quad\text{where}\quad |x - x' - s| \le \lceil \text{cutoff} \cdot \sigma \rceil

    With a ``circular`` border the distance is the shortest one around the ring; with a
    ``zero`` border the kernel keeps its form and reaches over the edge, where nothing is.
    """
    if border not in ("circular", "zero"):
        raise ValueError(f"border={border!r} is unknown: choose 'circular' or 'zero'")
    if not (sigma > 0 and cutoff > 0):
        raise ValueError(f"sigma={sigma} and cutoff={cutoff} must be positive")
    circular = border == "circular"
    distance = torch.arange(1 - n, n, dtype=torch.float64) - shift
    if circular:
        distance = (distance + n / 2) % n - n / 2
    taps = torch.exp(-0.5 * (distance / sigma) ** 2)
    taps = taps * (distance.abs() <= math.ceil(cutoff * sigma))
    if normalized:
        taps = taps / (taps[:n] if circular else taps).sum()
    return taps.unfold(0, n, 1).flip(-1)


def assemble(
    kernel: Kernel, shape: list[int], border: str | Sequence[str]
) -> tuple[list[Tensor], float]:
    """Matrices of a kernel on a field of ``shape``: for each axis a stack ``(terms, n, n)``
    in float64, and the amplitude of the global term.

    On one axis all terms, the global one too, are added to a single matrix; on none a
    Gaussian is a plain factor, as the global term is.
    """
    axes = len(shape)
    borders = per_axis("border", border, axes)
    total, terms = 0.0, []
    if isinstance(kernel, Gauss | Global | Matrices):  # a tuple itself, but of numbers
        kernel = (kernel,)
    for term in kernel:
        if isinstance(term, Global) or (isinstance(term, Gauss) and axes == 0):
            total += term.amplitude
            continue
        if isinstance(term, Gauss):
            sigma, shift = per_axis("sigma", term.sigma, axes), per_axis("shift", term.shift, axes)
            matrices = [
                gauss_matrix(n, *rest, term.cutoff, term.normalized)
                for n, *rest in zip(shape, sigma, borders, shift, strict=True)
            ]
            matrices[0] = term.amplitude * matrices[0]
        else:
            matrices = [matrix.detach().double() for matrix in term.matrices]
            if [list(matrix.shape) for matrix in matrices] != [[n, n] for n in shape]:
                sizes = [list(matrix.shape) for matrix in matrices]
                raise ValueError(f"matrices of {sizes} do not fit {shape=}: give (n, n) an axis")
        terms.append(matrices)
    terms = terms or [[torch.zeros(n, n, dtype=torch.float64) for n in shape]]
    stacks = [torch.stack(matrices) for matrices in zip(*terms, strict=True)]
    if axes == 1:
        return [stacks[0].sum(0, keepdim=True) + total], 0.0
    return stacks, total


def per_axis(name: str, value, axes: int) -> tuple:
    """``value`` for each axis: repeated if there is one for all."""
    values = tuple(value) if isinstance(value, (tuple, list)) else (value,) * axes
    if len(values) != axes:
        raise ValueError(f"{name}={value} has {len(values)} entries for {axes} axes: give one each")
    return values

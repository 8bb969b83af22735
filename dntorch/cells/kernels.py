r"""Kernels of lateral interaction: a sum of terms, each a product of one matrix per axis.

.. math:: \omega(x, x') = c_g + \sum_r \prod_a K_r^{(a)}(x_a, x'_a)

A kernel is a sequence of terms, in any order: `Gauss` (two of them make a difference of
Gaussians), `Global`, and `Matrices` for all that is neither. Amplitudes are signed: negative
ones inhibit. Distances are in sites, positions start at 0. A number may be a tensor of one
number that wants a gradient: the matrices are differentiable in it.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dntorch.checks import shown
from dntorch.number import span


class Gauss(NamedTuple):
    """A Gaussian that falls with the distance between two sites."""

    amplitude: float | Tensor
    """Sum over all taps if ``normalized``, else height of the middle."""
    sigma: float | Tensor | tuple[float | Tensor, ...]
    """Standard deviation in sites, one for all axes or one per axis; 0: the site itself alone."""
    shift: float | Tensor | tuple[float | Tensor, ...] = 0.0
    """Sites by which the effect lies to the right of its cause; moves peaks."""
    cutoff: float = 5.0
    """Half width in sigmas. (cedar's "limit" is the whole width.)"""
    normalized: bool = True
    """Divide by the sum over the taps kept."""


class Global(NamedTuple):
    """The same effect of every site on every site: a sum over the field."""

    amplitude: float | Tensor


class Matrices(NamedTuple):
    """A product of given matrices, one per axis, ``matrix[to, from]``."""

    matrices: tuple[Tensor, ...]


Kernel = Sequence[Gauss | Global | Matrices]

LARGEST = 2**31
"""Numbers of a matrix, beyond which no memory holds it."""

SELECTIVE: Kernel = (Gauss(20.0, 3.0), Global(-1.0))
"""Decides between two inputs, and lets go of the winner when its input goes."""


def gauss_matrix(
    n: int,
    sigma: float | Tensor,
    border: str = "circular",
    shift: float | Tensor = 0.0,
    cutoff: float = 5.0,
    normalized: bool = True,
) -> Tensor:
    r"""Matrix of a Gaussian along one axis, ``(n, n)`` in float64, ``matrix[to, from]``.

    .. math:: K(x, x') = \exp\left(-\frac{(x - x' - s)^2}{2 \sigma^2}\right)
              \quad\text{where}\quad |x - x' - s| \le \lceil \text{cutoff} \cdot \sigma \rceil

    With a ``circular`` border the distance is the shortest one around the ring; with a
    ``zero`` border the kernel keeps its form, wherever it is shifted, and reaches over the
    edge, where nothing is. Differentiable in ``sigma`` and ``shift``.
    """
    borders_of(border, 1)
    for name, number in (("sigma", sigma), ("shift", shift), ("cutoff", cutoff)):
        _check_one(name, number)
    (width, _), (place, _) = span(sigma), span(shift)
    if not (width >= 0 and cutoff > 0):
        raise ValueError(f"sigma={width} is negative, or cutoff={cutoff} not positive: give widths")
    # What reaches farther than all sites reaches all, from wherever it is shifted.
    reach = math.ceil(min(cutoff * width, 2.0 * n + abs(place)))
    sites = torch.arange(1 - n, n, dtype=torch.float64)

    def bell(distance: Tensor) -> Tensor:
        if width == 0:
            return (distance == 0).double()
        return torch.exp(-0.5 * (distance / sigma) ** 2) * (distance.abs() <= reach)

    if border == "circular":
        taps = bell((sites - shift + n / 2) % n - n / 2)
        total = taps[:n].sum()
    else:
        taps = bell(sites - shift)
        total = bell(sites - (shift - round(place))).sum()  # in the field or beyond it
    if normalized and bool(total > 0):
        taps = taps / total
    return taps.unfold(0, n, 1).flip(-1)


def assemble(
    kernel: Kernel,
    shape: list[int],
    border: str | Sequence[str],
    source: list[int] | None = None,
) -> tuple[list[Tensor], float | Tensor]:
    """Matrices of a kernel on a field of ``shape``: for each axis a stack ``(terms, n, n)``
    in float64, and the amplitude of the global term. From a field of another shape, ``source``,
    they are ``(terms, to, from)``.

    On one axis all terms, the global one too, are added to a single matrix; on none a
    Gaussian is a plain factor, as the global term is.

    Raises:
        ValueError: a term that is none or has no effect; the sentence shows it.
    """
    axes, source = len(shape), shape if source is None else source
    borders = borders_of(border, axes)
    for to, came in zip(shape, source, strict=True):
        if to * came > LARGEST:
            raise ValueError(f"{to} by {came} sites are too many for a matrix: take fewer")
    total, terms = 0.0, []
    for term in as_terms(kernel):
        try:
            _check_finite(term)
            if isinstance(term, Global) or (isinstance(term, Gauss) and axes == 0):
                total = total + term.amplitude
            elif isinstance(term, Gauss):
                if shape != source:
                    raise ValueError(
                        f"sizes {source} become {shape}: give Matrices of {shape[0]} by {source[0]}"
                    )
                terms.append(_gauss_matrices(term, shape, borders))
            else:
                terms.append(_given_matrices(term, shape, source))
        except ValueError as error:
            raise ValueError(f"{_shown(term)}: {error}") from error
    zeros = [torch.zeros(size, dtype=torch.float64) for size in zip(shape, source, strict=True)]
    terms = terms or [zeros]
    stacks = [torch.stack(matrices) for matrices in zip(*terms, strict=True)]
    if axes == 1:
        return [stacks[0].sum(0, keepdim=True) + total], 0.0
    return stacks, total


def as_terms(kernel: Any) -> tuple[Gauss | Global | Matrices, ...]:
    """A kernel as a tuple of terms."""
    if isinstance(kernel, Gauss | Global | Matrices):  # a tuple itself, but of numbers
        return (kernel,)
    terms = tuple(kernel) if isinstance(kernel, Sequence) and not isinstance(kernel, str) else None
    if terms is None or not all(isinstance(term, Gauss | Global | Matrices) for term in terms):
        raise ValueError(
            f"kernel={shown(kernel)} is no kernel: give terms, such as (Gauss(20.0, 3.0), "
            "Global(-1.0))"
        )
    return terms


def _gauss_matrices(term: Gauss, shape: list[int], borders: tuple) -> list[Tensor]:
    sigma = per_axis("sigma", term.sigma, len(shape))
    shift = per_axis("shift", term.shift, len(shape))
    matrices = [
        gauss_matrix(n, *rest, term.cutoff, term.normalized)
        for n, *rest in zip(shape, sigma, borders, shift, strict=True)
    ]
    if not all(bool(matrix.any()) for matrix in matrices):
        raise ValueError(
            f"no site has an effect on any other in a field of {shape}: take a larger sigma, or a "
            "shift within the field"
        )
    return [term.amplitude * matrices[0], *matrices[1:]]


def _given_matrices(term: Matrices, shape: list[int], source: list[int]) -> list[Tensor]:
    matrices = [torch.as_tensor(matrix).double() for matrix in term.matrices]
    sizes = [list(matrix.shape) for matrix in matrices]
    wanted = [list(size) for size in zip(shape, source, strict=True)]
    if not wanted:
        raise ValueError(
            f"matrices of {sizes} find no axis: name it alike on both sides of a projection, as in "
            "'x -> x', and give a node a number"
        )
    if sizes != wanted:
        raise ValueError(f"matrices of {sizes} do not fit {shape=}: give {wanted}, [to, from]")
    return matrices


def _check_finite(term: Gauss | Global | Matrices) -> None:
    for name, value in term._asdict().items():
        for each in value if isinstance(value, (tuple, list)) else (value,):
            _check_one(name, each, isinstance(term, Matrices))


def _check_one(name: str, value: Any, many: bool = False) -> None:
    try:
        number = torch.as_tensor(value, dtype=torch.float64).detach()
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise ValueError(f"{name} is no number: give floats") from None
    if number.numel() != 1 and not many:
        raise ValueError(f"{name} has {number.numel()} numbers: give one")
    if not bool(number.isfinite().all()):
        raise ValueError(f"{name} is not finite: give numbers")


def _shown(term: Gauss | Global | Matrices) -> str:
    """A term for people, numbers as numbers."""
    if isinstance(term, Matrices):
        return "Matrices"
    numbers = {
        name: value.detach().item() if isinstance(value, Tensor) and value.numel() == 1 else value
        for name, value in term._asdict().items()
    }
    return f"{type(term).__name__}({', '.join(f'{k}={v}' for k, v in numbers.items())})"


def borders_of(border: str | Sequence[str], axes: int) -> tuple[str, ...]:
    """A border for each axis; or raise."""
    borders = per_axis("border", border, axes)
    several = isinstance(border, (tuple, list))
    for word in borders if several else (border,):
        if not isinstance(word, str) or word not in ("circular", "zero"):
            raise ValueError(f"border={shown(word)} is unknown: choose 'circular' or 'zero'")
    return borders


def per_axis(name: str, value, axes: int) -> tuple:
    """``value`` for each axis: repeated if there is one for all."""
    values = tuple(value) if isinstance(value, (tuple, list)) else (value,) * axes
    if len(values) != axes:
        raise ValueError(f"{name}={value} has {len(values)} entries for {axes} axes: give one each")
    return values


def sites(shape: int | Sequence[int], name: str = "shape") -> list[int]:
    """Sites of each axis, an int for one axis."""
    whole = isinstance(shape, int) and not isinstance(shape, bool)
    several = isinstance(shape, Sequence) and not isinstance(shape, (str, bytes))
    given = [shape] if whole else list(shape) if several else [0]
    if not all(isinstance(n, int) and not isinstance(n, bool) and n >= 1 for n in given):
        raise ValueError(
            f"{name}={shown(shape)}: give a number of sites, at least one, for each axis"
        )
    if math.prod(given) > LARGEST:
        raise ValueError(f"{name}={shown(shape)}: these are too many sites, give fewer")
    return given

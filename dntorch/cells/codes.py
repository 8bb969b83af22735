r"""Rate code and space code: a number, and the place of a peak that stands for it.

Along a ``zero`` axis the first of n sites stands for ``low`` and the last for ``high``; on a
``circular`` axis, where ``low`` and ``high`` are the same direction, site k stands for
:math:`\text{low} + k (\text{high} - \text{low}) / n`.

One border is that of a line: numbers are ``(*batch,)`` and fields ``(*batch, n)``. A tuple has
one border per axis, and numbers have as many in a last dimension: ``(*batch, axes)``.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.kernels import per_axis, sites
from dntorch.cells.readout import Border, center_of_mass, field_of, words
from dntorch.cells.stimuli import gauss
from dntorch.checks import (
    check_finite_number,
    check_no_nan,
    check_real,
    count,
)

Bound = float | Sequence[float]
"""One number for all axes, or one per axis."""


def space_code(
    value: Tensor,
    shape: int | Sequence[int],
    low: Bound,
    high: Bound,
    sigma: Bound,
    border: Border = "circular",
    amplitude: float = 1.0,
) -> Tensor:
    r"""Numbers as places: a Gaussian bump over a field, at the site that stands for ``value``.

    .. math:: S(x) = A \exp\left(-\frac{(x - p)^2}{2 \sigma^2}\right), \qquad
              p = \frac{\text{value} - \text{low}}{\text{high} - \text{low}} \cdot
              \begin{cases} n & \text{circular} \\ n - 1 & \text{zero} \end{cases}

    a `gauss` there, with the shortest distance around a circular axis.

    =============  =====  ============================================================
    argument       unit   meaning
    =============  =====  ============================================================
    ``value``      any    what is coded
    ``shape``      sites  size of the field; a tuple has one per axis
    ``low, high``  any    the range that the axis stands for, one or one per axis
    ``sigma``      sites  width, one or one per axis
    ``border``     --     "circular" or "zero", one or one per axis
    ``amplitude``  1      height :math:`A` of the bump
    =============  =====  ============================================================

    Shapes: with a whole number as ``shape``, ``(*batch,)`` to ``(*batch, n)``; with a tuple,
    ``(*batch, axes)`` to ``(*batch, *shape)``. Differentiable in ``value``. On a circular axis
    values wrap around; on a zero axis one outside of the range leaves only the tail of its bump.
    `rate_code` inverts it; its docstring states the error.

    Raises:
        TypeError: ``value`` is no tensor of floats.
        ValueError: NaN in ``value``, no number per axis, ``low >= high``, ``sigma`` not positive,
            a zero axis of one site.

    >>> space_code(torch.tensor(90.0), 8, 0.0, 360.0, 1.0).argmax()
    tensor(2)
    """
    line, sizes = isinstance(shape, int), sites(shape)
    borders = words(border) * (len(sizes) if isinstance(border, str) else 1)
    scales = _scales(low, high, borders, sizes)
    check_finite_number("amplitude", amplitude)
    check_real("value", value)
    check_no_nan("value", value)
    columns = [value] if line else list(value.unbind(-1)) if value.dim() else []
    if len(columns) != len(sizes):
        raise ValueError(
            f"value of shape {list(value.shape)} does not end in [{len(sizes)}]: give a number "
            "per axis, or a whole number as shape for a line"
        )
    places = [(v - a) / step for v, (a, step) in zip(columns, scales, strict=True)]
    return gauss(sizes, places, sigma, amplitude, borders)


def rate_code(
    output: Tensor,
    low: Bound,
    high: Bound,
    border: Border = "circular",
    threshold: float = 0.5,
    silent: float | None = None,
) -> Tensor:
    r"""Places as numbers: what the centre of mass of a field stands for.

    .. math:: \text{value} = \text{low} + c\, \frac{\text{high} - \text{low}}{n}
              \quad\text{with}\quad
              c = \frac{n}{2\pi} \arg \sum_x f(x)\, e^{2 \pi i x / n}

    on a circular axis, in ``[low, high)``; on a zero axis :math:`c = \sum_x f(x) x / \sum_x f(x)`
    and n - 1 in place of n.

    =============  ====  ================================================================
    argument       unit  meaning
    =============  ====  ================================================================
    ``output``     1     firing rate of the field, not negative
    ``low, high``  any   the range that the axis stands for, one or one per axis
    ``border``     --    "circular" or "zero" of a line; a tuple has one per axis
    ``threshold``  1     a field is *silent* if no site is above it; 0 for activity that is
                         no firing rate
    ``silent``     any   the value of a silent field; by default the middle of the range
    =============  ====  ================================================================

    Shapes: with one border ``(*batch, n)`` to ``(*batch,)``; with a tuple
    ``(*batch, *shape)`` to ``(*batch, axes)``. Differentiable in ``output``.

    **A silent field** has no value. The result is ``silent``, and its gradient is zero; without
    this rule the tiny outputs of a resting field would give an arbitrary number. The same holds
    for a ring that is on evenly all around. Where the difference matters give
    ``silent=math.nan``, or ask ``output.amax(-1) > 0.5``. What is not finite gives NaN.

    **Error.** ``rate_code(space_code(value, n, low, high, sigma), low, high)`` is ``value``
    within 1e-5 of a site for a sigma from 1 to n/10 (in float64; float32 rounds to about 1e-7 of
    the range). A bump narrower than a site is drawn to the nearest one (at sigma 0.5 by up to
    0.03 sites). On a zero axis the bump must lie five sigma off the edges: one that the edge cuts
    is read too near the middle, by 0.8 sigma at the edge itself.

    Raises:
        TypeError: ``output`` is no tensor of floats.
        ValueError: a negative output, ``low >= high``, fewer dimensions than borders, a zero
            axis of one site.

    >>> rate_code(space_code(torch.tensor([10.0, 350.0]), 72, 0.0, 360.0, 3.0), 0.0, 360.0)
    tensor([ 10.0000, 350.0000])
    >>> rate_code(torch.zeros(72), 0.0, 360.0)
    tensor(180.)
    """
    borders, shape = field_of("output", output, border)
    scales = _scales(low, high, borders, shape)
    check_finite_number("threshold", threshold)
    if silent is not None and not (isinstance(silent, float) and math.isnan(silent)):
        check_finite_number("silent", silent)
    if negative := count(output < 0):
        raise ValueError(f"output has {negative} numbers below 0: give f(u), not the activation u")
    dims = list(range(-len(shape), 0))
    is_silent, values = ~(output.amax(dims) > threshold), []
    for axis, (word, (a, step), n) in enumerate(zip(borders, scales, shape, strict=True)):
        others = [dim for dim in dims if dim != axis - len(shape)]
        line = output.sum(others) if others else output
        center = center_of_mass(line, word)
        rest = a + step * (n if word == "circular" else n - 1) / 2 if silent is None else silent
        value = torch.where(is_silent | center.isnan(), rest, a + step * center)
        values.append(torch.where(line.isfinite().all(-1), value, math.nan))
    return values[0] if isinstance(border, str) else torch.stack(values, -1)


def _scales(
    low: Bound, high: Bound, borders: Sequence[str], shape: Sequence[int]
) -> list[tuple[float, float]]:
    """Per axis, the number of site 0 and from one site to the next; or raise."""
    axes = len(shape)
    if len(borders) != axes:
        raise ValueError(
            f"border={borders} has {len(borders)} words for {axes} axes: give one each"
        )
    scales = []
    for a, b, border, n in zip(
        per_axis("low", low, axes), per_axis("high", high, axes), borders, shape, strict=True
    ):
        check_finite_number("low", a)
        check_finite_number("high", b)
        if not a < b:
            raise ValueError(f"low={a} is not below high={b}: give the range in rising order")
        if border == "zero" and n == 1:
            raise ValueError("shape=1: a zero axis of one site has no range, give at least 2 sites")
        scales.append((float(a), (b - a) / (n if border == "circular" else n - 1)))
    return scales

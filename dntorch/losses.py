r"""Losses that teach a field where peaks shall be: differentiable, one number per field.

They take the **activation** ``u``, not the output: the output of a silent field has no gradient,
while :math:`\ell(x) = \log(1 + e^x)` of an activation has one however far it is from where it
should be. Each loss is :math:`\log 2` at the threshold, whatever the size of the field.

One border is that of a line, ``u`` of ``(*batch, n)``; a tuple has one border per axis of the
field, ``u`` of ``(*batch, *shape)``. ``reduction`` is over the batch: "mean", "sum", or "none" for
a loss per field, ``(*batch,)``.
"""

import math

import torch
from torch import Tensor
from torch.nn.functional import softplus

from dntorch.cells.codes import Bound
from dntorch.cells.kernels import per_axis
from dntorch.cells.readout import Border, field_of
from dntorch.cells.stimuli import gauss
from dntorch.checks import check_finite_number, check_no_nan, check_real, check_within, shown

REACH = 3.0
"""Sigmas from where a peak shall be within which more sites may be on."""


def peak_loss(
    u: Tensor,
    position: Tensor,
    sigma: Bound,
    border: Border = "circular",
    threshold: float = 0.0,
    reduction: str = "mean",
) -> Tensor:
    r"""Small for a peak at ``position`` and none elsewhere.

    .. math:: L = \frac{\sum_x w(x)\, \ell(\mu - u(x))}{\sum_x w(x)}
              + \ell\left(\max_{|x - p| > 3 \sigma} u(x) - \mu\right), \qquad
              w(x) = \max\left(0,\, e^{-(x - p)^2 / 2 \sigma^2} - e^{-1/2}\right)

    The first term wants the sites within one sigma of the position on, most of all the middle;
    the second wants all beyond three sigma off. Those between are free, so that a field may have
    peaks of its own width. Below :math:`\log 2` a site is on here, and none is far away.

    ==============  =====  ================================================================
    argument        unit   meaning
    ==============  =====  ================================================================
    ``u``           1      activation of the field, not its output
    ``position``    sites  where the peak shall be, from 0; may lie between sites
    ``sigma``       sites  tolerance, at least 1; one or one per axis
    ``border``      --     "circular" or "zero" of a line; a tuple has one per axis
    ``threshold``   1      a site is on above it
    ``reduction``   --     "mean", "sum" or "none"
    ==============  =====  ================================================================

    Shapes: ``position`` is ``(*batch,)`` for a line and ``(*batch, axes)`` with a tuple of
    borders, or broadcasts to that. Differentiable in ``u``, and through w in ``position``.

    Raises:
        TypeError: ``u`` or ``position`` is no tensor of floats.
        ValueError: NaN, shapes that do not fit, ``sigma`` below one site, a position
            beyond a zero border, an unknown reduction.

    >>> u = torch.full((51,), -5.0)
    >>> silent = peak_loss(u, torch.tensor(20.0), 2.0)
    >>> u[18:23] = 5.0
    >>> here, elsewhere = (peak_loss(u, torch.tensor(p), 2.0) for p in (20.0, 40.0))
    >>> here < silent < elsewhere
    tensor(True)
    """
    borders, shape = _checked(u, border, threshold, reduction)
    batch = list(u.shape[: u.dim() - len(shape)])
    for width in per_axis("sigma", sigma, len(shape)):
        real = isinstance(width, int | float) and not isinstance(width, bool)
        if not real or not 1 <= width < math.inf:
            raise ValueError(f"sigma={shown(width)} is less than one site: give at least 1")
    places = _places(position, batch, border, len(shape))
    for place, n, word in zip(places, shape, borders, strict=True):
        if word == "zero":
            check_within("position", place, 0, n - 1)
    bell = gauss(shape, places, sigma, 1.0, borders)
    dims = list(range(-len(shape), 0))
    weight = torch.relu(bell - math.exp(-0.5))
    here = (weight * softplus(threshold - u)).sum(dims) / weight.sum(dims)
    near = bell >= math.exp(-0.5 * REACH**2)
    far = softplus(torch.where(near, -math.inf, u).amax(dims) - threshold)
    return _reduced(here + far, reduction)


def no_peak_loss(
    u: Tensor, border: Border = "circular", threshold: float = 0.0, reduction: str = "mean"
) -> Tensor:
    r"""Small for a field without a peak.

    .. math:: L = \ell\left(\max_x u(x) - \mu\right)

    Below :math:`\log 2` no site is on. Arguments, shapes and errors as those of `peak_loss`;
    ``border`` says how many axes the field has. The gradient is that of the highest site, 1 in
    a strong peak and 0.007 in a field that rests five below its threshold.

    >>> no_peak_loss(torch.full((51,), -5.0)) < 0.01
    tensor(True)
    """
    _, shape = _checked(u, border, threshold, reduction)
    highest = u.amax(list(range(-len(shape), 0)))
    return _reduced(softplus(highest - threshold), reduction)


def _checked(
    u: Tensor, border: Border, threshold: float, reduction: str
) -> tuple[tuple[str, ...], list[int]]:
    if not isinstance(reduction, str) or reduction not in ("mean", "sum", "none"):
        raise ValueError(f"reduction={shown(reduction)} is unknown: choose 'mean', 'sum' or 'none'")
    check_finite_number("threshold", threshold)
    borders, shape = field_of("u", u, border)
    if abs(threshold) > torch.finfo(u.dtype).max:
        raise ValueError(f"threshold={threshold} is not finite in {u.dtype}: give a smaller one")
    check_no_nan("u", u)
    return borders, shape


def _places(position: Tensor, batch: list[int], border: Border, axes: int) -> list[Tensor]:
    check_real("position", position)
    check_no_nan("position", position)
    whole = batch if isinstance(border, str) else [*batch, axes]
    try:
        position = position.expand(whole)
    except RuntimeError:
        raise ValueError(
            f"position of shape {list(position.shape)} does not fit {whole}: give a number per "
            "field and axis"
        ) from None
    return [position] if isinstance(border, str) else list(position.unbind(-1))


def _reduced(loss: Tensor, reduction: str) -> Tensor:
    if reduction == "none":
        return loss
    return loss.mean() if reduction == "mean" else loss.sum()

"""Output functions: from activation to firing rate, elementwise; and what a firing rate says.

All output functions but `rectified`, `semilinear` and ``linear`` run from 0 to 1 and are 1/2 at
``threshold``.
"""

import torch
from torch import Tensor

from dntorch.number import Number, either


def abs_sigmoid(u: Tensor, steepness: float, threshold: float) -> Tensor:
    r"""Sigmoid without exponential, eq. (4) of the paper, and "AbsSigmoid" of field software.

    .. math:: f_S(u) = \frac12 \left(1 + \frac{\beta (u-\mu)}{1 + \beta |u-\mu|}\right)

    computed as :math:`(s + x) / 2s` with :math:`x = u - \mu` and :math:`s = |x| + 1/\beta`.
    Not a fast logistic: it differs from one by up to .082 and has an algebraic tail,
    f(-5) = 1e-3 at a steepness of 100.

    **Deviation**: printed as :math:`(1+\beta(x-\mu)) / (2(1+\beta|x-\mu|))`, which is 1/2 for
    every x above the threshold and tends to -1/2 below it, while the text says "bounded
    between 0 and 1".
    """
    x = u - threshold
    scale = x.abs() + 1 / steepness
    return (scale + x) / (scale + scale)


def logistic(u: Tensor, steepness: float, threshold: float) -> Tensor:
    r"""Logistic sigmoid, :math:`f(u) = 1 / (1 + e^{-\beta (u-\mu)})`."""
    if threshold != 0:  # in eager mode an operation less, and the same number
        u = u - threshold
    return torch.sigmoid(steepness * u)


@either
def heaviside(u: Tensor, threshold: Number) -> Tensor:
    """One above the threshold, zero at and below it, in the dtype of ``u``."""
    return (u > threshold).to(u.dtype)


def rectified(u: Tensor, threshold: float) -> Tensor:
    """``u`` above the threshold, zero at and below it (threshold-linear, with a jump)."""
    return torch.where(u > threshold, u, 0)  # NaN is above nothing


def semilinear(u: Tensor, steepness: float, threshold: float) -> Tensor:
    r"""Zero up to the threshold, then a line, :math:`f(u) = \beta \max(0, u - \mu)`."""
    return torch.relu(steepness * (u - threshold))


KINDS = ("abs", "logistic", "heaviside", "semilinear", "linear")


def sigmoid(u: Tensor, kind: str, steepness: float, threshold: float) -> Tensor:
    """The output function called ``kind``, one of `KINDS`."""
    if kind == "abs":
        return abs_sigmoid(u, steepness, threshold)
    if kind == "logistic":
        return logistic(u, steepness, threshold)
    if kind == "heaviside":
        return heaviside(u, threshold)
    if kind == "semilinear":
        return semilinear(u, steepness, threshold)
    if kind == "linear":
        return steepness * (u - threshold)
    raise ValueError(
        f"kind='{kind}' is no output function: choose 'abs', 'logistic', 'heaviside', "
        "'semilinear' or 'linear'"
    )


def finite(x: Tensor) -> Tensor:
    """``x`` with 0 in place of NaN and infinity; whole numbers as they are."""
    return torch.nan_to_num(x, nan=0.0, posinf=0.0, neginf=0.0) if x.is_floating_point() else x


def differ(x: Tensor, mended: Tensor, batch: list[int]) -> Tensor:
    """In which members of ``batch`` two inputs differ; shape ``()`` for what all share."""
    bad, dims = x != mended, len(batch)
    if list(x.shape[:dims]) != batch:
        return bad.any()
    return bad.any(list(range(dims, x.dim()))) if x.dim() > dims else bad


def cleaned(
    given: dict[str, Tensor], dtype: torch.dtype, batch: list[int], bad: Tensor
) -> tuple[dict[str, Tensor], Tensor]:
    """Inputs in one dtype with 0 for what is not finite; ``bad``, or who had such a number.

    Whole numbers, such as images, stay as they are.
    """
    clean: dict[str, Tensor] = {}
    for name, value in given.items():
        if value.is_floating_point():
            value = value.to(dtype)
            clean[name] = finite(value)
            bad = bad | differ(value, clean[name], batch)
        else:
            clean[name] = value
    return clean, bad


def is_on(rate: Tensor) -> Tensor:
    """Whether a node is on: its firing rate is above 1/2. Takes NumPy arrays, too."""
    return rate > 0.5


def came_on(before: Tensor, after: Tensor) -> Tensor:
    """Whether a node came on between two firing rates. Takes NumPy arrays, too.

    A behaviour is completed when its CoS node comes on: this is where everything that counts,
    reports or records completed behaviours gets them from.
    """
    return is_on(after) > is_on(before)

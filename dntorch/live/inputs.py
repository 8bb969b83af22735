"""Inputs with the form of a peak: put by hand, or found in a constant stimulus."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from dntorch.cells.stimuli import gauss
from dntorch.checks import check_positive


@dataclass(frozen=True)
class Peak:
    """A Gaussian over the sites of a field; of a node, which has none, an amplitude.

    Raises:
        ValueError: ``sigma`` that is not positive; the sentence of `gauss`.
    """

    shape: tuple[int, ...]
    position: tuple[float, ...]
    sigma: tuple[float, ...]
    amplitude: float
    border: tuple[str, ...]

    def tensor(self) -> Tensor:
        """The input, float64."""
        if not self.shape:
            return torch.tensor(self.amplitude, dtype=torch.float64)
        for sigma in self.sigma:
            check_positive("sigma", sigma, "give a width in sites")
        amplitude = torch.tensor(self.amplitude, dtype=torch.float64)
        return gauss(self.shape, self.position, self.sigma, amplitude, self.border)

    def changed(self, name: str, axis: int, value: float) -> "Peak":
        """The same with another number; ``axis`` of a position or width."""
        if name == "amplitude":
            return replace(self, amplitude=value)
        numbers = list(getattr(self, name))
        numbers[axis] = value
        return replace(self, **{name: tuple(numbers)})

    def holds(self, position: Sequence[float]) -> bool:
        """Whether a place is within one sigma of the middle."""
        near = zip(position, self.position, self.sigma)
        return all(abs(x - middle) <= max(0.5, sigma) for x, middle, sigma in near)


def peak_for(part: Any, shape: Sequence[int], position: Sequence[float]) -> Peak:
    """An input that lifts a part of resting level ``h`` well above its threshold."""
    h, threshold = (float(getattr(part, name, 0.0)) for name in ("h", "threshold"))
    border = getattr(part, "border", "zero")
    borders = tuple(border) if isinstance(border, (tuple, list)) else (border,) * len(shape)
    sigma = tuple(round(0.5 + n / 25, 2) for n in shape)
    amplitude = round(max(1.0, threshold - h + 3.0), 2)
    return Peak(tuple(shape), tuple(position), sigma, amplitude, borders)


def recognised(value: Tensor) -> Peak | None:
    """The peak that a constant stimulus is, to rounding; None if it is none.

    The logarithm of a Gaussian is a parabola: three sites at the top give place and width.
    """
    x, shape = value.detach().double(), tuple(value.shape)
    if not shape or not bool(x.isfinite().all()) or not bool(x.any()):
        return None
    place = [int(k) for k in torch.unravel_index(x.abs().argmax(), shape)]
    top, position, sigma, height = x[tuple(place)], [], [], 0.0
    for axis, n in enumerate(shape):
        sides = [x[tuple((*place[:axis], (place[axis] + d) % n, *place[axis + 1 :]))]
                 for d in (-1, 1)]  # fmt: skip
        left, right = (float((side / top).clamp_min(0).log()) for side in sides)
        bend = left + right
        if not (-math.inf < bend < -1e-9):
            return None
        offset = (right - left) / (-2 * bend)
        position.append(place[axis] + offset)
        sigma.append((-1 / bend) ** 0.5)
        height += offset**2 * -bend / 2
    for border in ("circular", "zero"):
        peak = Peak(
            shape, tuple(position), tuple(sigma), float(top) * math.exp(height),
            (border,) * len(shape),
        )  # fmt: skip
        if torch.allclose(peak.tensor(), x, rtol=0, atol=1e-4 * float(x.abs().max())):
            return peak
    return None

"""A part at one moment, and what it was before, as arrays to draw."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dntorch.live.watched import Watched

ROWS = 200
"""Steps that a space-time plot shows."""


class Picture(NamedTuple):
    """A part at one moment; float32, of 0 to 2 axes. Of three the largest along the first."""

    activation: np.ndarray
    output: np.ndarray
    input: np.ndarray
    trail: np.ndarray
    """activation of the last steps, ``(ROWS, n)``, newest last; of two axes the largest along y"""


def picture_of(part: Watched, rows: Sequence[np.ndarray]) -> Picture:
    """How a part is now; ``rows`` are profiles of its last steps, at most `ROWS`."""
    seen = (part.activation(), part.output(), part.input)
    trail = np.full((ROWS, len(rows[0])), np.nan, np.float32)
    trail[ROWS - len(rows) :] = np.stack(rows)
    return Picture(*(_array(_flat(each)) for each in seen), trail)


def _flat(tensor: Tensor) -> Tensor:
    """At most two axes."""
    return tensor.amax(0) if tensor.dim() == 3 else tensor


def profile(tensor: Tensor) -> np.ndarray:
    """One axis: the largest along the others."""
    for _ in range(tensor.dim() - 1):
        tensor = tensor.amax(0)
    return _array(tensor).reshape(-1)


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().to("cpu", torch.float32).numpy().copy()

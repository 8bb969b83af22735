r"""Intrinsic values: which action, at which level of a lamp, makes the lamp brighter.

.. math:: \dot W_{ik} = \eta\, o_{ik} (c\, l - W_{ik})
"""

import torch
from torch import Tensor

from dntorch.number import Number, either


def tuned(brightness: Tensor, levels: int) -> Tensor:
    """Rates of nodes tuned to ``levels`` brightnesses from 0 to 1, ``(*batch, levels)``."""
    preferred = torch.arange(levels, dtype=brightness.dtype, device=brightness.device)
    return (1 - (brightness * (levels - 1) - preferred).abs()).clamp_min(0.0)


@either
def curiosity_step(
    offset: Tensor, change: Tensor, weights: Tensor, learning_rate: Number, gain: Number, dt: float
) -> Tensor:
    """One Euler step of ``dt`` seconds; ``weights`` is ``[action, level]``."""
    return weights + dt * learning_rate * offset * (gain * change - weights)

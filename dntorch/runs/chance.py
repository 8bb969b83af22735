"""Noise of exploration, drawn ahead for a portion of steps.

Since draws are keyed by (seed, agent, decision), a table of the next decisions holds the very
numbers that an agent alone would draw, and no agent depends on who else is in its batch.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.noise import Exploration

ROWS, HALF = 32, 16
"""Decisions that a table has room for, and steps between two looks at how full it is: an agent
takes at most one a step."""


class Chance(NamedTuple):
    """What a portion of steps may need."""

    step: Tensor
    """control step with which the portion begins"""
    decision: Tensor
    """number of the decision of row 0, ``(*batch,)``"""
    noise: Tensor
    """``(*batch, ROWS, n)``; zeros in exploitation"""


def draw(
    exploration: Exploration, step: Tensor, decisions: Tensor, exploring: bool, dtype: torch.dtype
) -> Chance:
    """Chance for a portion that begins at ``step``, after ``decisions`` of each agent."""
    if exploring:
        noise = exploration.ahead(decisions, ROWS, dtype)
    else:
        shape = (*decisions.shape, ROWS, exploration.n)
        noise = torch.zeros(shape, dtype=dtype, device=decisions.device)
    return Chance(step.clone(), decisions.clone(), noise)


def noise_of(decisions: Tensor, chance: Chance) -> Tensor:
    """Noise of the next decision of each agent, ``(*batch, n)``."""
    row = (decisions - chance.decision).clamp(0, ROWS - 1)[..., None, None]
    n = chance.noise.shape[-1]
    return chance.noise.gather(-2, row.expand(*row.shape[:-1], n)).squeeze(-2)

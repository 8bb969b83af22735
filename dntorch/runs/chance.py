"""Chance, drawn ahead for a portion of steps.

Since draws are keyed by (seed, agent, decision), a table of the next decisions holds the very
numbers that an agent alone would draw, and no agent depends on who else is in its batch.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.envs.nodes import NodesWorld
from dntorch.noise import Exploration, keyed_uniform
from dntorch.runs.group import Group

PORTION = 500
"""Control steps for which chance is drawn ahead."""
ROWS = PORTION // 31
"""Events that an agent may have in a portion: a behaviour takes longer than a second."""


class Chance(NamedTuple):
    """Draws of a portion of steps."""

    noise: Tensor
    """``(ROWS, n, n, batch)``, for the decisions from ``decision`` on"""
    decision: Tensor
    duration: Tensor
    """``(ROWS, batch)``, for the visits from ``visit`` on"""
    visit: Tensor


class TabledWorld(NodesWorld):
    """`NodesWorld` with durations from a table and without a branch, as a compiler wants it."""

    durations: Tensor
    first: Tensor

    def renew(self, begun: Tensor, visits: Tensor, duration: Tensor) -> Tensor:
        rows = (visits - self.first).clamp(0, ROWS - 1)
        return torch.where(begun, self.durations[rows, torch.arange(rows.shape[0])], duration)


class Dice:
    """All that is random in the lives of a `Group`.

    Args:
        group: who draws.
        world: where the durations of behaviours come from.
        dtype: of the noise.
    """

    LEAD = 7

    def __init__(self, group: Group, world: NodesWorld, dtype: torch.dtype) -> None:
        config = group.config
        self.group, self.config, self.world, self.dtype = group, config, world, dtype
        self.agents, self.n = torch.tensor(group.agents), len(config.colors)
        self.exploration = Exploration(self.n, config.seed, self.agents, config.noise)

    def draw(self, decision: Tensor, visit: Tensor, exploring: bool) -> Chance:
        """What a portion of steps may need that begins with these decisions and visits."""
        rows = torch.arange(ROWS).unsqueeze(-1)
        noise = torch.zeros(ROWS, self.n, self.n, len(self.agents), dtype=self.dtype)
        if exploring:
            noise = torch.stack([self.noise(decision + row) for row in range(ROWS)])
        duration = self.world.draw(visit + rows)
        return Chance(noise, decision.clone(), duration, visit.clone())

    def noise(self, decisions: Tensor) -> Tensor:
        """Noise of one decision of each agent, ``(n, n, batch)``."""
        drawn = self.exploration(decisions, self.dtype).movedim(0, -1).contiguous()
        return self.lead(drawn, decisions) if self.group.shown else drawn

    def lead(self, noise: Tensor, decisions: Tensor) -> Tensor:
        """Noise that leads through the rewarded sequences, ``shown`` times while exploring."""
        shown, targets = self.group.shown, self.world.task.targets
        targets = targets[torch.arange(shown) % len(targets)]
        zero = torch.zeros_like(self.agents)
        share = keyed_uniform(self.config.seed, self.agents, zero, shown, self.LEAD)
        starts = ((0.1 + 0.75 * share) * self.config.explore / 180).to(torch.int64)
        place = decisions.unsqueeze(-1) - starts  # (batch, shown): position in each showing
        inside = (place >= 0) & (place < targets.shape[1])
        which = inside.to(torch.int64).argmax(-1)
        place = place.gather(-1, which.unsqueeze(-1))[:, 0].clamp(0, targets.shape[1] - 1)
        forced = torch.nn.functional.one_hot(targets[which, place], self.n).to(noise.dtype)
        forced = self.config.noise * forced.T.unsqueeze(1)
        return torch.where(inside.any(-1), forced, noise)

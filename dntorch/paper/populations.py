"""Groups of the paper's studies: a changed agent, further sequences, led exploration."""

from dataclasses import dataclass

import torch
from torch import Tensor

from dntorch.envs.task import SequenceTask
from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import Exploration, keyed_uniform
from dntorch.paper.variants import build_variant
from dntorch.runs.group import Group
from dntorch.runs.worlds import build_task


@dataclass(frozen=True)
class Population(Group):
    """Agents with one thing changed."""

    variant: str = ""
    """what is changed, of `dntorch.paper.variants`"""
    tasks: tuple[str, ...] = ()
    """rewarded sequences beside that of ``config``"""
    shown: int = 0
    """how often exploration is led through the sequence, at random times"""

    def build_agent(self) -> DNSarsa:
        return build_variant(self.config, self.variant)

    def build_task(self) -> SequenceTask:
        return build_task(self.config, self.tasks)

    def build_exploration(self) -> Exploration:
        exploration = super().build_exploration()
        if self.shown:
            exploration = Led(exploration, self.shown, self.build_task(), self.config.explore)
        return exploration


class Led(Exploration):
    """Noise that leads through the rewarded sequences, ``shown`` times while exploring."""

    LEAD = 7
    SPACING = 180
    """control steps that a behaviour takes, about"""

    def __init__(self, usual: Exploration, shown: int, task: SequenceTask, explore: int) -> None:
        super().__init__(usual.n, usual.seed, usual.agents, usual.amplitude)
        self.shown, self.explore = shown, explore
        self.targets = task.targets[torch.arange(shown) % len(task.targets)]

    def ahead(self, decisions: Tensor, rows: int, dtype: torch.dtype = torch.float32) -> Tensor:
        usual = super().ahead(decisions, rows, dtype)
        led = [self._lead(usual[..., k, :], decisions + k) for k in range(rows)]
        return torch.stack(led, -2)

    def _lead(self, noise: Tensor, decisions: Tensor) -> Tensor:
        zero = torch.zeros_like(self.agents)
        share = keyed_uniform(self.seed, self.agents, zero, self.shown, self.LEAD)
        starts = ((0.1 + 0.75 * share) * self.explore / self.SPACING).to(torch.int64)
        place = decisions.unsqueeze(-1) - starts  # (batch, shown): position in each showing
        inside = (place >= 0) & (place < self.targets.shape[1])
        which = inside.to(torch.int64).argmax(-1)
        place = place.gather(-1, which.unsqueeze(-1))[:, 0].clamp(0, self.targets.shape[1] - 1)
        forced = torch.nn.functional.one_hot(self.targets[which, place], self.n).to(noise.dtype)
        return torch.where(inside.any(-1)[:, None], self.amplitude * forced, noise)

"""Groups of the paper's studies: a changed agent, further sequences, led exploration."""

from dataclasses import dataclass

import torch
from torch import Tensor

from dntorch.envs.nodes import NodesWorld
from dntorch.envs.task import SequenceTask
from dntorch.envs.world import World
from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import Exploration, keyed_uniform
from dntorch.paper.drawn import DrawnTask, draw_feasible, draw_targets
from dntorch.paper.variants import build_variant
from dntorch.runs.build import build_agent
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
    drawn: bool = False
    """each agent has a rewarded sequence of its own, as long as that of ``config``"""
    count: int = 0
    """of behaviours, if not one for each colour: in the abstract world, with ``drawn``"""
    after: int = 0
    """after how many others each behaviour is possible, drawn for each agent; 0: after all"""

    def __post_init__(self) -> None:
        super().__post_init__()
        n, abstract = self.n, self.config.world == "nodes"
        if (self.count or self.after) and not (abstract and self.drawn):
            raise ValueError(
                f"count={self.count}, after={self.after}: give world='nodes' and drawn=True, too"
            )
        if self.drawn and (self.config.then or self.tasks or self.config.missing or self.variant):
            raise ValueError("drawn=True knows no then, tasks, missing or variant: leave them out")
        if self.after >= n:
            raise ValueError(f"after={self.after}: there are {n - 1} others, give fewer")

    @property
    def n(self) -> int:
        return self.count or len(self.config.colors)

    def build_agent(self) -> DNSarsa:
        if self.count:
            return build_agent(self.config, self.count)
        return build_variant(self.config, self.variant)

    def build_task(self) -> SequenceTask:
        task = build_task(self.config, self.tasks)
        if self.drawn:
            who, length = (self.config.seed, self.agents, self.n), len(self.config.sequence)
            task = DrawnTask(task, draw_targets(*who, length, self._feasible()), self.n)
        return task

    def build_world(self, senses: tuple[str, ...], device: str) -> World:
        """The abstract one where not all is possible after all."""
        if not self.after:
            return super().build_world(senses, device)
        return NodesWorld(
            self.build_task(), senses=senses, feasible=self._feasible(), device=device
        )

    def _feasible(self) -> Tensor | None:
        if not self.after:
            return None
        return draw_feasible(self.config.seed, self.agents, self.n, self.after)

    def build_exploration(self) -> Exploration:
        exploration = super().build_exploration()
        exploration.n = self.n
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

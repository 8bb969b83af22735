"""Many agents of the abstract world in one batch, remembered as events.

A step of world and agents is one pure function, compiled where there is a compiler; what
depends on chance is drawn ahead for a portion of steps.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils._pytree import tree_map

from dntorch import files
from dntorch.cells.functions import came_on, is_on
from dntorch.envs.nodes import NodesState
from dntorch.modules.sarsa import AgentState
from dntorch.paper.variants import build_variant
from dntorch.runs.chance import PORTION, Chance, Dice, TabledWorld
from dntorch.runs.events import Events, Log, empty_log, write
from dntorch.runs.group import Group
from dntorch.runs.worlds import build_task


class Running(NamedTuple):
    """All that changes from step to step."""

    step: Tensor
    observation: dict[str, Tensor]
    reward: Tensor
    agent: AgentState
    world: NodesState
    error: Tensor
    """integrals of v and |v| since the last onset, ``(2, batch)``"""
    trouble: Tensor
    """steps with two intentions on, steps without a state, ``(2, batch)``"""
    log: Log


def innermost(tensor: Tensor) -> Tensor:
    """The same tensor with its first dimension, the batch, innermost in memory: twice as fast."""
    if tensor.dim() < 2:
        return tensor.clone()
    return tensor.movedim(0, -1).contiguous().movedim(-1, 0)


class Population:
    """Agents of one `Group` that live, each in a world of its own, from step 0 to the last.

    ``advance`` may be called with any portions, ``content`` and ``load`` between them: same
    machine, same batch, same numbers. Another split into batches: the same decisions.

    Args:
        group: who runs.
        dtype: of the neural dynamics.
        compiled: fuse the step with torch.compile; False needs no C++ compiler and is slower.
    """

    def __init__(
        self, group: Group, dtype: torch.dtype = torch.float32, compiled: bool = True
    ) -> None:
        self.group, self.config, self.dtype = group, group.config, dtype
        self.n, self.batch = len(self.config.colors), len(group.agents)
        config = self.config
        self.agent = build_variant(config, group.variant).to(dtype).spread(self.batch)
        task = build_task(config, group.tasks)
        self.world = TabledWorld(task, config.seed, torch.tensor(group.agents))
        self.dice = Dice(group, self.world, dtype)
        self._individualize()
        self.running = self.initial()
        self.now = 0
        self.events = Events(group)
        self.step = self._step
        if compiled:
            self.step = torch.compile(self._step, fullgraph=True, dynamic=False)

    def _individualize(self) -> None:
        """Give each agent numbers of its own."""
        for path, values in self.group.parameters.items():
            value = torch.tensor(values, dtype=self.dtype)
            if path == "reward":
                self.world.task.reward = value
            elif path == "reward_duration":
                self.world.task.steps = (value / self.config.dt).round().to(torch.int64)
            elif path == "noise":
                self.dice.exploration.amplitude = value.double()
            else:
                part, _, name = path.rpartition(".")
                setattr(self.agent.get_submodule(part), name, value)

    def initial(self) -> Running:
        batch, n, zeros = self.batch, self.n, torch.zeros
        rest = self.agent.initial([batch])
        return Running(
            torch.zeros((), dtype=torch.int64),
            {"match": zeros(batch, n, dtype=self.dtype)},
            zeros(batch, dtype=self.dtype),
            tree_map(innermost, rest),
            tree_map(innermost, self.world.initial()),
            zeros(2, batch, dtype=self.dtype),
            zeros(2, batch, dtype=torch.int64),
            empty_log(batch, n, self.dtype),
        )

    # ------------------------------------------------------------------ one step

    def _step(self, running: Running, chance: Chance) -> Running:
        each = torch.arange(self.batch)
        before = self.agent.behaviors.satisfaction.output(running.agent.behaviors.satisfaction)
        rows = (running.agent.decisions - chance.decision).clamp(0, chance.noise.shape[0] - 1)
        noise = chance.noise[rows, :, :, each]
        intention, agent = self.agent.step(
            running.observation, running.reward, noise, running.agent
        )
        self.world.durations, self.world.first = chance.duration, chance.visit
        outcome, world = self.world.step(intention, running.world)
        after = self.agent.behaviors.satisfaction.output(agent.behaviors.satisfaction)
        risen = came_on(before, after)
        error = agent.learner.opposition.error
        error = running.error + self.config.dt * torch.stack((error, error.abs()))
        weights = agent.learner.values.weights if self.group.keep_weights else None
        log = write(running.log, running.step, risen, error, outcome, weights)
        trouble = torch.stack((is_on(intention).sum(-1) > 1, ~is_on(after).any(-1)))
        return Running(
            running.step + 1,
            outcome.observation,
            outcome.reward.to(self.dtype),
            agent,
            world,
            torch.where(risen.any(-1), 0, error),
            running.trouble + trouble,
            log,
        )

    # ------------------------------------------------------------------ many steps

    @property
    def finished(self) -> bool:
        return self.now >= self.config.steps

    @torch.inference_mode()
    def advance(self, steps: int = PORTION) -> None:
        """Take up to ``steps`` control steps, not beyond the end of the run."""
        end = min(self.now + steps, self.config.steps)
        while self.now < end:
            edge = self.config.explore if self.now < self.config.explore else self.config.steps
            last = min(end, edge, self.now + PORTION)
            if self.now >= self.config.explore and not self.group.learns_in_exploitation:
                self.agent.learn(False)
            running = self.running
            chance = self.dice.draw(
                running.agent.decisions, running.world.visits, self.now < self.config.explore
            )
            for _ in range(self.now, last):
                self.running = self.step(self.running, chance)
            self.now = last
            self._collect()

    def _collect(self) -> None:
        """Take the events of a portion out of the log."""
        self.events.collect(self.running.log)
        for name, moment in (("explored", self.config.explore), ("end", self.config.steps)):
            if self.now == moment:
                self.events.put(f"weights_{name}", self.running.agent.learner.values.weights)

    # ------------------------------------------------------------------ files

    def results(self) -> dict[str, np.ndarray]:
        """Events in order of agents and steps; see `dntorch.paper.runs.Runs`."""
        return self.events.joined() | {"trouble": self.running.trouble.numpy().copy()}

    def content(self) -> dict[str, Any]:
        """What a checkpoint holds."""
        flat = torch.utils._pytree.tree_leaves(self.running)
        return {
            "group": self.group.description(),
            "now": self.now,
            "running": [tensor.contiguous() for tensor in flat],
            "events": self.events.arrays(),
        }

    def save(self, path: Path) -> None:
        files.save(path, self.content())

    @torch.inference_mode()
    def load(self, path: Path) -> "Population":
        """Go on from a checkpoint of the same group."""
        content = files.load(path)
        flat = torch.utils._pytree.tree_leaves(self.running)
        saved = content["running"]
        self.group.check(content.get("group", ""), path)
        for own, other in zip(flat, saved):
            own.copy_(other)
        self.now = content["now"]
        self.events.restore(content["events"])
        return self


def run(
    population: Population,
    path: Path | None = None,
    save_every: int = 10_000,
    progress: Callable[[int], bool] = lambda step: True,
) -> bool:
    """Run to the end with checkpoints; stop and save when ``progress(step)`` says False."""
    if path is not None and path.exists():
        population.load(path)
    while not population.finished:
        population.advance()
        go_on = progress(population.now)
        if path is not None and (population.now % save_every == 0 or not go_on):
            population.save(path)
        if not go_on:
            return False
    return True

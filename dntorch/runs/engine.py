"""Agent, world and exploration as one function of a moment: the loop of every run.

    moment -> noise of this decision -> agent -> action -> world -> outcome -> memory -> moment

The same for one agent and for a batch, eager and compiled, whatever is remembered. A pure world
is compiled together with the agent; before another one the agent alone is.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.envs.world import Outcome, World
from dntorch.modules.sarsa import AgentState, DNSarsa
from dntorch.noise import Exploration
from dntorch.runs.chance import HALF, Chance, draw, noise_of
from dntorch.runs.compiling import Alternating, Compiled, overwrite

SECONDS = 16.0
"""Simulated seconds of a portion, for which chance is drawn ahead."""


class Moment(NamedTuple):
    """All that changes from step to step."""

    step: Tensor
    """control steps taken, int64"""
    observation: dict[str, Tensor]
    reward: Tensor
    agent: AgentState
    world: Any
    log: Any
    """rows of the portion that runs, as the memory wants them"""


class Memory(Protocol):
    """What is kept of a run. `write` is called within a compiled step, `collect` between."""

    def log(self, agent: AgentState, rows: int) -> Any: ...
    def write(
        self, log: Any, row: Tensor, before: AgentState, after: AgentState, outcome: Outcome
    ) -> Any: ...
    def collect(self, log: Any, first: int, steps: int) -> None: ...
    def snapshot(self) -> dict[str, np.ndarray]: ...
    def restore(self, snapshot: dict[str, np.ndarray], log: Any) -> Any: ...


class Engine:
    """Steps agents in their world.

    Args:
        agent: with the batch of the world, values of its own for each member.
        world: where it acts.
        exploration: the noise while it explores.
        memory: what is kept.
        state: of the world, at first.
        compiled: fuse a step with torch.compile; it needs a C++ compiler.
    """

    def __init__(
        self,
        agent: DNSarsa,
        world: World,
        exploration: Exploration,
        memory: Memory,
        state: Any,
        compiled: bool = False,
    ) -> None:
        self.agent, self.world, self.exploration, self.memory = agent, world, exploration, memory
        self.portion = max(1, round(SECONDS / agent.dt))
        self.dtype = agent.weights.dtype
        self.moment = self._first(state)
        self.in_place, self._fused = compiled and world.pure, None
        if self.in_place:
            with torch.inference_mode():  # as every step: the compiler tells the two kinds apart
                self.moment = laid_out(self.moment)
            self._step = Alternating(self._step)
            self._fused = self._step.write
        elif compiled:
            self._decide = self._fused = Compiled(self._decide)

    @torch.inference_mode()
    def _first(self, state: Any) -> Moment:
        agent = self.agent.state
        observation = self.world.observe(state)
        for name, value in observation.items():
            observation[name] = value.to(self.dtype) if value.is_floating_point() else value
        return Moment(
            torch.zeros((), dtype=torch.int64, device=agent.decisions.device),
            observation,
            torch.zeros_like(agent.decisions, dtype=self.dtype),
            agent,
            state,
            self.memory.log(agent, self.portion),
        )

    # ------------------------------------------------------------------ one step

    def _step(self, moment: Moment, chance: Chance) -> Moment:
        action, agent = self._decide(moment.observation, moment.reward, moment.agent, chance)
        outcome, world = self.world.step(action, moment.world)
        row = moment.step - chance.step
        log = self.memory.write(moment.log, row, moment.agent, agent, outcome)
        reward = outcome.reward.to(self.dtype)
        return Moment(moment.step + 1, outcome.observation, reward, agent, world, log)

    def _decide(
        self, observation: dict[str, Tensor], reward: Tensor, state: AgentState, chance: Chance
    ) -> tuple[Tensor, AgentState]:
        return self.agent.step(observation, reward, noise_of(state.decisions, chance), state)

    # ------------------------------------------------------------------ many steps

    @torch.inference_mode()
    def restore(self, moment: Moment) -> None:
        """Go on from another moment; a compiled step keeps its addresses."""
        self._go_on(moment)
        self.agent.state = self.moment.agent

    def _go_on(self, moment: Moment) -> None:
        if self.in_place:
            overwrite(self.moment, moment)
        else:
            self.moment = moment

    @torch.inference_mode()
    def advance(self, now: int, steps: int, exploring: bool) -> None:
        """Take ``steps`` control steps from step ``now`` on, with the agent as it is now."""
        self._go_on(self.moment._replace(agent=self.agent.state))
        if self._fused:
            self._fused.sure = False
        end = now + steps
        while now < end:
            now += self._portion(now, min(self.portion, end - now), exploring)
        self.agent.state = self.moment.agent

    def _portion(self, first: int, count: int, exploring: bool) -> int:
        """Up to ``count`` steps with chance drawn ahead; how many were taken."""
        self._go_on(self.moment._replace(world=self.world.provide(self.moment.world)))
        moment = self.moment
        chance = draw(self.exploration, moment.step, moment.agent.decisions, exploring, self.dtype)
        if self.in_place:
            chance = pytree.tree_map(innermost, chance)
        for taken in range(1, count + 1):
            moment = self._step(moment, chance)
            if taken % HALF == 0 and self._crowded(moment, chance):
                break
        self.moment = moment
        self.memory.collect(moment.log, first, taken)
        return taken

    @property
    def compiled(self) -> bool:
        """Whether the step is compiled; not where this machine failed to."""
        return self._fused is not None and not self._fused.failed

    @property
    def compiling(self) -> float:
        """Seconds that compiling took so far, 0 where nothing is compiled."""
        return self._fused.seconds if self._fused else 0.0

    def _crowded(self, moment: Moment, chance: Chance) -> bool:
        """Whether a table of chance or events might be full before the next look.

        A working agent takes five decisions in a portion; one of the paper's misprints flickers.
        """
        many = bool((moment.agent.decisions - chance.decision >= HALF).any())
        return many or self.world.due(moment.world)


def innermost(tensor: Tensor) -> Tensor:
    """The same tensor with its first dimension, the batch, innermost in memory: twice as fast."""
    if not isinstance(tensor, Tensor) or tensor.dim() < 2:
        return tensor.clone() if isinstance(tensor, Tensor) else tensor
    return tensor.movedim(0, -1).contiguous().movedim(-1, 0)


def laid_out(moment: Moment) -> Moment:
    """The same moment as a compiled step of a batch likes it in memory: nodes batch innermost.

    Images and fields of two axes are rows of matrix products: they stay as they are.
    """

    def kept(tensor: Tensor) -> Tensor:
        return tensor.clone() if tensor.dim() > 2 else innermost(tensor)

    nodes = pytree.tree_map(innermost, moment)
    seen, fields = pytree.tree_map(kept, (moment.observation, moment.agent.sensorimotor))
    return nodes._replace(observation=seen, agent=nodes.agent._replace(sensorimotor=fields))

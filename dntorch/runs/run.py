"""A run: agents in their worlds, from the first step to the last, stoppable at any."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch.utils import _pytree as pytree

from dntorch import files
from dntorch.modules.sarsa import DNSarsa
from dntorch.process import can_compile
from dntorch.quantities import Interval, check_kind, shown
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config, kept_config
from dntorch.runs.engine import Engine
from dntorch.runs.events import Events
from dntorch.runs.group import Group
from dntorch.runs.record import Record
from dntorch.runs.worlds import WORLDS


class Run:
    """``config.steps`` control steps of a `Group`: exploration first, then exploitation.

    The agents learn all along. ``advance`` may be called with any portions, ``save`` and
    ``restore`` between them; the numbers are the same. Another split of a group into batches,
    or none, makes the same decisions.

    Args:
        group: who runs; a `Config` for one agent without a batch.
        events: remember events instead of every step.
        dtype: of the neural dynamics.
        device: of the whole run.
        compiled: fuse the step with torch.compile; it needs a C++ compiler.

    Raises:
        ValueError: a batch in a world that holds one agent.
    """

    def __init__(
        self,
        group: Group | Config,
        events: bool = False,
        dtype: torch.dtype = torch.float32,
        device: str = "cpu",
        compiled: bool = False,
    ) -> None:
        self.group = group if isinstance(group, Group) else Group(group)
        self.config, batch = self.group.config, self.group.batch
        if batch and not WORLDS[self.config.world].batched:
            raise ValueError(
                f"batch={batch[0]}: only worlds of pure tensors run as a batch, world="
                f"{self.config.world!r} holds one agent; run one by one"
            )
        self.agent = self.group.build_agent().to(device=device, dtype=dtype)
        if batch:
            self.agent.spread(*batch)
        self.world = self.group.build_world(self.agent.senses, device)
        exploration = self.group.build_exploration()
        self.group.individualize(self.agent, self.world.task, exploration)
        names = self.group.rows or self.group.agents or tuple(range(*batch or (1,)))
        if events:
            self.memory = Events(self.agent, names, self.group.keep_weights)
        else:
            states = self.agent.learner.states
            self.memory = Record(self.config.steps, self.agent.behaviors, batch, states)
        seeds, agents = (number.to(device) for number in self.group.numbers)
        state = self.world.initial(batch, seeds, agents)
        self.engine = Engine(self.agent, self.world, exploration, self.memory, state, compiled)
        self.step = 0

    @property
    def record(self) -> Record:
        """What happened, step by step, of a run that remembers all of it."""
        return self.memory

    @property
    def compiled(self) -> bool:
        """Whether the step is compiled; not where this machine failed to."""
        return self.engine.compiled

    @property
    def finished(self) -> bool:
        return self.step >= self.config.steps

    def advance(self, steps: int) -> None:
        """Take up to ``steps`` control steps, not beyond the end of the run.

        Raises:
            ValueError: no whole number of steps.
        """
        if steps not in Interval(0, math.inf, whole=True):
            raise ValueError(f"steps={shown(steps)}: give a whole number, 0 or more")
        end = min(self.step + steps, self.config.steps)
        while self.step < end:
            exploring = self.step < self.config.explore
            last = min(end, self.config.explore) if exploring else end
            if not exploring and not self.group.learns_in_exploitation:
                self.agent.learn(False)
            self.engine.advance(self.step, last - self.step, exploring)
            self.step = last
            self._keep_weights()

    def _keep_weights(self) -> None:
        if isinstance(self.memory, Events):
            for name, moment in (("explored", self.config.explore), ("end", self.config.steps)):
                if self.step == moment:
                    self.memory.put(f"weights_{name}", self.agent.weights)
                    self.memory.put(f"failures_{name}", self.agent.failures.reshape(-1))

    def member(self, k: int) -> "Trial":
        """One agent of a batch that remembers every step, as if it had run alone.

        Raises:
            ValueError: there is no such agent, or only events are remembered.
        """
        if not isinstance(self.memory, Record) or k not in range(*self.group.batch or (0,)):
            raise ValueError(
                f"k={k}: give a place in the batch={list(self.group.batch)} of a Run(events=False)"
            )
        trial, moment = Trial(self.group.member(k)), self.engine.moment
        own = pytree.tree_map(
            lambda leaf: leaf[k].clone(), moment._replace(step=moment.reward, log=())
        )
        before = trial.engine.moment
        trial.engine.restore(own._replace(step=moment.step.clone(), log=before.log))
        trial.memory, trial.step = self.record.member(k), self.step
        trial.engine.memory = trial.memory
        return trial

    def close(self) -> None:
        self.world.close()

    # ------------------------------------------------------------------ files

    def content(self) -> dict[str, Any]:
        """What a checkpoint holds: all that is needed to go on to the very same numbers."""
        moment = self.engine.moment
        return {
            "group": self.group.description(),
            "config": asdict(self.config),
            "step": self.step,
            "compiled": self.compiled,
            "agent": self.agent.snapshot(),
            "world": self.world.snapshot(moment.world),
            "seen": [moment.observation, moment.reward],
            "memory": self.memory.snapshot(),
        }

    def save(self, path: Path) -> None:
        files.save(path, self.content())

    @torch.inference_mode()
    def restore(self, path: Path) -> "Run":
        """Go on from a checkpoint of the same group.

        Raises:
            ValueError: no checkpoint, a damaged one, or one of other runs.
        """
        content = files.load(path)
        with _fitting(path):
            self.group.check(content.get("group", ""), path)
            step, seen = content["step"], content["seen"]
            if step not in Interval(0, self.config.steps, whole=True):
                raise TypeError(f"step={shown(step)} is none of {self.config.steps}")
            self.agent.restore(content["agent"])
            moment = self.engine.moment
            if not isinstance(seen, list) or _form(seen) != _form(
                [moment.observation, moment.reward]
            ):
                raise TypeError("the agent has seen something else")
            observation, reward = seen
            self.engine.restore(
                moment._replace(
                    step=torch.full_like(moment.step, step),
                    observation=observation,
                    reward=reward,
                    agent=self.agent.state,
                    world=self.world.restore(content["world"], moment.world),
                    log=self.memory.restore(content["memory"], moment.log),
                )
            )
            self.step = step
        return self


class Trial(Run):
    """A run of one agent that remembers every step."""

    def __init__(self, config: Config, compiled: bool = False) -> None:
        check_kind("config", config, Config)
        super().__init__(config, compiled=compiled)

    @classmethod
    def load(cls, path: Path) -> "Trial":
        """Go on from a checkpoint, compiled if it was and a compiler is there.

        Raises:
            ValueError: no checkpoint, a damaged one, or one of another architecture.
        """
        content = files.load(path)
        if "world" not in content:
            raise ValueError(
                f"{path} holds learned values and no world: use it with export or robot run"
            )
        with _fitting(path):
            compiled = content["compiled"] and can_compile()
            trial = cls(kept_config(content["config"], path), compiled)
        return trial.restore(path)


def load_trained(path: Path) -> tuple[DNSarsa, Config]:
    """The agent of a checkpoint, with what it learned, without its world.

    Raises:
        ValueError: as `Trial.load`.
    """
    content = files.load(path)
    with _fitting(path):
        config = kept_config(content["config"], path)
        agent = build_agent(config)
        agent.restore(content["agent"])
    return agent, config


def _form(tensors: Any) -> tuple:
    leaves, structure = pytree.tree_flatten(tensors)
    return structure, [(leaf.shape, leaf.dtype) for leaf in leaves]


@contextmanager
def _fitting(path: Path) -> Iterator[None]:
    """Say of a checkpoint whose content is not what is read here that it is of another version."""
    try:
        yield
    except Exception as error:
        if isinstance(error, ValueError) and "\n" not in str(error):  # says itself what is wrong
            if str(path) in str(error):
                raise
            raise ValueError(f"{path} cannot be used: {error}") from error
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise ValueError(
            f"{path} is of another version of dntorch ({reason}): use that version, or begin a "
            "new run"
        ) from error

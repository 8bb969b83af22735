"""Trials of the abstract world as one batch: each step is computed once for all of them."""

import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch import files
from dntorch.cells.functions import is_on
from dntorch.envs.nodes import NodesWorld
from dntorch.envs.task import NOTHING
from dntorch.noise import Exploration
from dntorch.process import postponed
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.record import reported
from dntorch.runs.train import PORTION
from dntorch.runs.trial import Trial
from dntorch.runs.worlds import build_task

#: In what the runs of a batch may differ.
INDIVIDUAL = ("seed", "learning_rate", "trace_tau", "reward", "reward_duration", "noise")


class Together:
    """Runs that differ in nothing but `INDIVIDUAL`, side by side.

    Each makes the decisions that its `Trial` makes alone; values agree to rounding.

    Raises:
        ValueError: runs that are no batch.
    """

    def __init__(self, configs: tuple[Config, ...]) -> None:
        first = configs[0]
        for config in configs:
            build_agent(config)  # raises for a value that makes no agent
            common = {name: getattr(first, name) for name in INDIVIDUAL}
            if replace(config, **common) != first or first.world != "nodes":
                raise ValueError(f"{config} and {first} make no batch: run them one by one")
        self.configs, self.config, size = configs, first, len(configs)
        self.agent = build_agent(first).spread(size)
        seeds = torch.tensor([config.seed for config in configs])
        none = torch.zeros(size, dtype=torch.int64)
        self.world = NodesWorld(build_task(first), seeds, none)
        self.exploration = Exploration(self.agent.n, seeds, none, first.noise)
        self._individualize()
        self.steps = 0
        self.state, self.place = self.agent.state, self.world.initial()
        self.observation = {"match": torch.zeros(size, self.agent.n)}
        self.reward = torch.zeros(size)
        shape = (first.steps, size)
        self.found = np.full(shape, NOTHING, np.int8)
        self.completed = np.zeros(shape, np.bool_)
        self.on = np.zeros((2, *shape, self.agent.n), np.bool_)

    def _individualize(self) -> None:
        """Give each agent, and the world it lives in, the numbers of its run."""
        learner, task = self.agent.learner, self.world.task
        for name, part, attribute in (
            ("learning_rate", learner.values, "learning_rate"),
            ("trace_tau", learner.trace, "tau"),
            ("reward", task, "reward"),
            ("noise", self.exploration, "amplitude"),
        ):
            values = [getattr(config, name) for config in self.configs]
            if len(set(values)) > 1:
                dtype = torch.float64 if name == "noise" else torch.float32
                setattr(part, attribute, torch.tensor(values, dtype=dtype))
        lengths = [round(config.reward_duration / config.dt) for config in self.configs]
        task.steps = torch.tensor(lengths)

    @torch.inference_mode()
    def advance(self, steps: int) -> None:
        none = torch.zeros_like(self.agent.weights)
        state, behaviors = self.state, self.agent.behaviors
        for t in range(self.steps, min(self.steps + steps, self.config.steps)):
            exploring = t < self.config.explore
            noise = self.exploration(state.decisions) if exploring else none
            action, state = self.agent.step(self.observation, self.reward, noise, state)
            step, self.place = self.world.step(action, self.place)
            self.observation, self.reward = step.observation, step.reward
            self.found[t], self.completed[t] = step.found.numpy(), step.completed.numpy()
            for nodes, rate in zip(self.on, behaviors.output(state.behaviors)):
                nodes[t] = is_on(rate).numpy()
            self.steps = t + 1
        self.state = state

    def train(self, path: Path, save_every: int = 5_000) -> tuple[list[Trial], float]:
        """To the end, from the checkpoint at ``path`` if there is one; also gives seconds.

        Raises:
            KeyboardInterrupt: Ctrl-C or SIGTERM came, and the batch is saved where it stands.
        """
        if path.exists():
            self.load(path)
        began, end = time.monotonic(), self.config.steps
        with postponed() as asked:
            while self.steps < end and not asked():
                self.advance(min(PORTION, save_every - self.steps % save_every))
                if self.steps % save_every == 0 or self.steps == end or asked():
                    files.save(path, self.content())
        return [self.member(k) for k in range(len(self.configs))], time.monotonic() - began

    def content(self) -> dict:
        """What a checkpoint holds."""
        moving = (self.state, self.place, self.observation, self.reward)
        cut = {"found": self.found, "completed": self.completed}
        return {
            "configs": [asdict(config) for config in self.configs],
            "moving": pytree.tree_leaves(moving),
            "on": self.on[:, : self.steps],
            **{name: array[: self.steps] for name, array in cut.items()},
        }

    def load(self, path: Path) -> None:
        content = files.load(path)
        if content["configs"] != [asdict(config) for config in self.configs]:
            raise ValueError(f"{path} is of a batch of other runs: name another folder")
        moving = (self.state, self.place, self.observation, self.reward)
        structure = pytree.tree_structure(moving)
        moving = pytree.tree_unflatten(content["moving"], structure)
        self.state, self.place, self.observation, self.reward = moving
        self.steps = len(content["found"])
        self.on[:, : self.steps] = content["on"]
        self.found[: self.steps], self.completed[: self.steps] = (
            content["found"],
            content["completed"],
        )

    def member(self, k: int) -> Trial:
        """One run, as if it had been alone. Its record says of nodes only if they were on."""

        def own(value: Tensor) -> Tensor:
            return value[k].clone()

        trial = Trial(self.configs[k])
        trial.agent.state = pytree.tree_map(own, self.state)
        trial.world.state = pytree.tree_map(own, self.place)
        trial.observation = pytree.tree_map(own, self.observation)
        trial.reward = own(self.reward)
        record, t = trial.record, self.steps
        record.length = t
        record.intention[:t], record.satisfaction[:t] = self.on[:, :t, k]
        record.found[:t], record.completed[:t] = self.found[:t, k], self.completed[:t, k]
        after = record.satisfaction[:t]
        before = np.concatenate((np.zeros_like(after[:1]), after[:-1]))
        record.reported[:t] = reported(before, after)
        return trial

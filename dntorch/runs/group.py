"""Which agents run as one batch, and in what they differ."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor

from dntorch.envs.task import SequenceTask
from dntorch.envs.world import NUMBERS, World
from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import Exploration
from dntorch.parameters import Parameters
from dntorch.quantities import check_kind, shown
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.config import Config, check_setting
from dntorch.runs.worlds import build_task, build_world

#: Where a number of a config lies within an agent; others are of its task or its exploration.
PATHS = {"learning_rate": "learner.values.learning_rate", "trace_tau": "learner.trace.tau"}
OUTSIDE = ("reward", "reward_duration", "noise")
#: In what the runs of a batch may differ.
INDIVIDUAL = ("seed", *PATHS, *OUTSIDE)


@dataclass(frozen=True)
class Group:
    """Which agents run, and what they share. Without seeds and agents: one, without a batch.

    Subclasses of the paper's studies change what is built.

    Raises:
        ValueError: numbers that are not one for each agent, or that none may have.
    """

    config: Config
    agents: tuple[int, ...] = ()
    """their numbers; all 0 if there are only seeds"""
    seeds: tuple[int, ...] = ()
    """of each; all that of the config if there are only numbers"""
    parameters: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """numbers of each agent's own: the path within the agent (``"learner.trace.tau"``), or
    ``"reward"``, ``"reward_duration"``, ``"noise"``"""
    learns_in_exploitation: bool = True
    keep_weights: bool = True
    """remember the values at every event"""
    rows: tuple[int, ...] = ()
    """what to call each agent in the events, by default its place"""

    def __post_init__(self) -> None:
        check_kind("config", self.config, Config)
        each = {"agents": self.agents, "seeds": self.seeds, "rows": self.rows}
        for name, numbers in each.items():
            if not isinstance(numbers, Sequence) or any(k not in NUMBERS for k in numbers):
                raise ValueError(f"{name}={shown(numbers)}: give a tuple, each {NUMBERS}")
        count, each = len(self.agents or self.seeds), {**each, **self.parameters}
        for name, numbers in each.items():
            wanted = max(count, 1) if name == "rows" else count
            if len(numbers) != wanted and (name in self.parameters or numbers):
                raise ValueError(
                    f"{name}={shown(numbers)} has {len(numbers)} numbers for {wanted} agents: give "
                    "one for each of agents or seeds"
                )
        for name in set(self.parameters) & set(OUTSIDE):
            for number in self.parameters[name]:
                check_setting(name, number)
                if name == "reward_duration" and number < self.config.dt:
                    raise ValueError(f"{name}={number}: give at least dt={self.config.dt}")

    @classmethod
    def of(cls, configs: tuple[Config, ...]) -> "Group":
        """Runs that differ in nothing but `INDIVIDUAL`.

        Raises:
            ValueError: runs that are no batch.
        """
        if not configs:
            raise ValueError(f"configs={configs!r}: give at least one")
        first, parameters = configs[0], {}
        for config in configs:
            build_agent(config)  # raises for a value that makes no agent
            common = {name: getattr(first, name) for name in INDIVIDUAL}
            if replace(config, **common) != first:
                raise ValueError(f"{config} and {first} make no batch: run them one by one")
        for name in INDIVIDUAL[1:]:
            values = tuple(float(getattr(config, name)) for config in configs)
            if len(set(values)) > 1:
                parameters[PATHS.get(name, name)] = values
        return cls(first, seeds=tuple(c.seed for c in configs), parameters=parameters)

    # ------------------------------------------------------------------ who

    @property
    def batch(self) -> tuple[int, ...]:
        count = len(self.agents or self.seeds)
        return (count,) if count else ()

    @property
    def numbers(self) -> tuple[Tensor, Tensor]:
        """Seed and number of each agent, int64, ``(*batch,)``."""
        if not self.batch:
            return torch.tensor(self.config.seed), torch.tensor(0)
        count = self.batch[0]
        seeds = self.seeds or (self.config.seed,) * count
        return torch.tensor(seeds), torch.tensor(self.agents or (0,) * count)

    def member(self, k: int) -> Config:
        """The config of one agent, as if it ran alone."""
        names = {path: name for name, path in PATHS.items()}
        own = {names.get(path, path): v[k] for path, v in self.parameters.items()}
        return replace(self.config, seed=int(self.numbers[0][k]), **own)

    def part(self, first: int, last: int) -> "Group":
        """The agents of these places."""
        cut = {name: getattr(self, name)[first:last] for name in ("agents", "seeds", "rows")}
        own = {name: values[first:last] for name, values in self.parameters.items()}
        return replace(self, parameters=own, **cut)

    # ------------------------------------------------------------------ what is built

    def build_agent(self) -> DNSarsa:
        """Without a batch, as all of them are."""
        return build_agent(self.config)

    def build_exploration(self) -> Exploration:
        exploration = build_exploration(self.config)
        seeds, exploration.agents = self.numbers
        exploration.seed = seeds if self.seeds else self.config.seed
        return exploration

    def build_task(self) -> SequenceTask:
        return build_task(self.config)

    def build_world(self, senses: tuple[str, ...], device: str) -> World:
        return build_world(self.config, senses, self.build_task(), device)

    def individualize(self, agent: DNSarsa, task: SequenceTask, exploration: Exploration) -> None:
        """Give each agent of a batch, and the world it lives in, numbers of its own."""
        dtype, device = agent.weights.dtype, agent.weights.device
        for path, values in self.parameters.items():
            value = torch.tensor(values, dtype=torch.float64, device=device)
            if path == "reward":
                task.reward = value.to(dtype)
            elif path == "reward_duration":
                task.steps = (value / self.config.dt).round().to(torch.int64)
            elif path == "noise":
                exploration.amplitude = value
            else:
                part, _, name = path.rpartition(".")
                structure = dict(agent.named_modules()).get(part)
                if not isinstance(structure, Parameters) or name not in structure.numeric():
                    raise ValueError(
                        f"parameters={path!r} is no number of the agent: give a path such as "
                        f"{PATHS['trace_tau']!r}, or one of {OUTSIDE}"
                    )
                setattr(structure, name, value.to(dtype))

    # ------------------------------------------------------------------ files

    def description(self) -> str:
        """All of it in one line, which finished and begun runs keep."""
        return json.dumps(asdict(self), sort_keys=True)

    def check(self, description: str, path: Path) -> None:
        """Raise unless the runs kept at ``path`` are those of this group."""
        if description != self.description():
            raise ValueError(f"{path} is of another group of runs: name another folder")

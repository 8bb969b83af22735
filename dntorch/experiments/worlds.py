"""The worlds of a run behind one face: tensors in, tensors out, a state that can be saved."""

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from dntorch.body import Body
from dntorch.envs.nodes import NodesState, NodesWorld
from dntorch.envs.task import SequenceTask, TaskState
from dntorch.experiments.config import Config, build_agent

if TYPE_CHECKING:
    from dntorch.envs.epuck import EPuckEnv


class Outcome(NamedTuple):
    """What a world answers to an action."""

    observation: dict[str, Tensor]
    """of each name in the world's senses"""
    reward: Tensor
    found: int
    """position of the colour found in this step, or -1"""
    completed: bool
    """the rewarded sequence was completed in this step"""


class World(Protocol):
    """One world for one agent."""

    def reset(self) -> dict[str, Tensor]: ...
    def step(self, action: Tensor) -> Outcome: ...
    def snapshot(self) -> dict[str, Any]: ...
    def restore(self, snapshot: dict[str, Any]) -> None: ...
    def close(self) -> None: ...


def build_task(config: Config, others: tuple[str, ...] = ()) -> SequenceTask:
    """What a run rewards, ``others`` beside its sequence."""
    return SequenceTask(
        config.sequence, config.colors, config.reward, config.reward_duration, config.dt, others
    )


def build_epuck(config: Config, **others: Any) -> "EPuckEnv":
    """The PyBullet world of a run; ``others`` as in `EPuckEnv`."""
    from dntorch.envs.epuck import EPuckEnv  # numpy, gymnasium and pybullet are an extra

    return EPuckEnv(
        build_task(config), body=Body(width=config.width, height=config.height), **others
    )


def build_world(config: Config, senses: tuple[str, ...] | None = None) -> World:
    """The world of a run; it shows ``senses``, by default what the agent of the run reads."""
    return EPuck(config, senses) if config.world == "epuck" else Nodes(config, senses)


def tensors(observation: dict[str, np.ndarray]) -> dict[str, Tensor]:
    """An observation of a Gymnasium env as an agent reads it."""
    return {name: torch.from_numpy(value) for name, value in observation.items()}


class Nodes:
    """The abstract world; it shows ``match`` alone."""

    def __init__(self, config: Config, senses: tuple[str, ...] | None = None) -> None:
        for name in senses or ():
            if name != "match":
                raise ValueError(f"senses={senses}: {name!r} is unknown, give ('match',)")
        self.world = NodesWorld(build_task(config), config.seed)
        self.state = self.world.initial()

    def reset(self) -> dict[str, Tensor]:
        self.state = self.world.initial()
        return {"match": torch.zeros(self.world.n)}

    def step(self, action: Tensor) -> Outcome:
        step, self.state = self.world.step(action, self.state)
        return Outcome(step.observation, step.reward, int(step.found), bool(step.completed))

    def snapshot(self) -> dict[str, Any]:
        *own, task = self.state
        return {"own": list(own), "task": list(task)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        self.state = NodesState(*snapshot["own"], TaskState(*snapshot["task"]))

    def close(self) -> None:
        pass


class EPuck:
    """The PyBullet world; what is not in ``senses`` is not computed."""

    def __init__(
        self,
        config: Config,
        senses: tuple[str, ...] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.seed = config.seed
        senses = build_agent(config).senses if senses is None else senses
        self.env = build_epuck(config, senses=senses, render_mode=render_mode)

    def reset(self) -> dict[str, Tensor]:
        observation, _ = self.env.reset(seed=self.seed)
        return tensors(observation)

    def step(self, action: Tensor) -> Outcome:
        observation, reward, _, _, info = self.env.step(action.numpy())
        return Outcome(
            tensors(observation),
            torch.tensor(reward, dtype=torch.float32),
            int(info["found"]),
            bool(info["completed"]),
        )

    def snapshot(self) -> dict[str, Any]:
        return self.env.state_dict()

    def restore(self, snapshot: dict[str, Any]) -> None:
        self.env.reset(seed=self.seed)
        self.env.load_state_dict(snapshot)

    def close(self) -> None:
        self.env.close()

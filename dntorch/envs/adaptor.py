"""A Gymnasium env of this library as a world: PyBullet, or a robot."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor

from dntorch.envs.task import SequenceTask
from dntorch.envs.world import Outcome, World
from dntorch.quantities import check_kind

NOWHERE = -1


class GymState(NamedTuple):
    """Names a moment of the env, which itself holds all the rest."""

    steps: int
    """control steps since the beginning"""


class GymWorld(World[GymState]):
    """One env, for one agent. It cannot go back: a step asks for the state of the last one.

    Args:
        env: with ``task``, and ``found`` and ``completed`` in its info.

    Raises:
        ValueError: an env without a task, a batch, a snapshot of something else.
        RuntimeError: a step from a state that is not the last.
    """

    pure = False

    def __init__(self, env: gymnasium.Env) -> None:
        check_kind("env", env, gymnasium.Env)
        task = getattr(env.unwrapped, "task", None)
        check_kind("task", task, SequenceTask)
        self.env, self.task = env, task
        self.senses = tuple(env.observation_space)
        self._steps = 0

    @property
    def actions(self) -> tuple[int, float, float]:
        space = self.env.action_space
        return space.shape[0], float(space.low[0]), float(space.high[0])

    def initial(
        self, batch: tuple[int, ...] = (), seed: int | Tensor = 0, agents: int | Tensor = 0
    ) -> GymState:
        if batch or torch.as_tensor(seed).dim() or torch.as_tensor(agents).dim():
            raise ValueError(f"batch={list(batch)}: this world holds one agent, run one by one")
        self._seed, self._steps = int(seed), 0
        self._seen, _ = self.env.reset(seed=self._seed)
        return GymState(0)

    def observe(self, state: GymState) -> dict[str, Tensor]:
        self._require(state)
        return tensors(self._seen)

    def step(self, action: Tensor, state: GymState) -> tuple[Outcome, GymState]:
        self._require(state)
        self._seen, reward, _, _, info = self.env.step(action.numpy())
        self._steps += 1
        outcome = Outcome(
            tensors(self._seen),
            torch.tensor(reward, dtype=torch.get_default_dtype()),
            torch.tensor(int(info["found"])),
            torch.tensor(bool(info["completed"])),
        )
        return outcome, GymState(self._steps)

    def snapshot(self, state: GymState) -> Any:
        self._require(state)
        return {"env": self.env.unwrapped.state_dict(), "steps": self._steps, "seed": self._seed}

    def restore(self, snapshot: Any, state: GymState) -> GymState:
        if not isinstance(snapshot, dict) or snapshot.keys() != {"env", "steps", "seed"}:
            raise ValueError("the snapshot is of another world: restore it where it was taken")
        self._steps = NOWHERE  # unless all of it is restored, no state is that of the env
        self.env.reset(seed=snapshot["seed"])
        self.env.unwrapped.load_state_dict(snapshot["env"])
        self._seen = self.env.unwrapped.observe()
        self._steps, self._seed = snapshot["steps"], snapshot["seed"]
        return GymState(self._steps)

    def close(self) -> None:
        self.env.close()

    def _require(self, state: GymState) -> None:
        if state.steps != self._steps:
            raise RuntimeError(
                f"the env is at step {self._steps} and the state at {state.steps}: an env cannot "
                "go back, give the state of its last step or restore a snapshot"
            )


def tensors(observation: dict[str, np.ndarray]) -> dict[str, Tensor]:
    """An observation of a Gymnasium env as an agent reads it."""
    return {name: torch.from_numpy(value) for name, value in observation.items()}

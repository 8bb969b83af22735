"""What every Gymnasium env of a robot with a task has, simulated or real."""

from abc import abstractmethod
from collections.abc import Sequence

import gymnasium
import numpy as np
from gymnasium import spaces

from dntorch.body import Body
from dntorch.envs.sensors import observation_space
from dntorch.envs.task import SequenceTask, TaskState
from dntorch.quantities import check_kind, per_second


class TaskEnv(gymnasium.Env):
    """An env that rewards a sequence; one step takes ``dt`` seconds.

    Args:
        task: what is rewarded, and the length of one control step; ``None``: the paper's.
        body: the robot: what its camera sees, how fast its wheels may turn.
        senses: names in the observation.

    Raises:
        ValueError: something else than a task or a body, an unknown sense.
    """

    def __init__(self, task: SequenceTask | None, body: Body, senses: Sequence[str]) -> None:
        self.task = SequenceTask() if task is None else task
        check_kind("task", self.task, SequenceTask)
        check_kind("body", body, Body)
        self.body, cap = body, body.speed_cap
        self.metadata = {**self.metadata, "render_fps": per_second(self.dt)}
        self.action_space = spaces.Box(-cap, cap, (2,), np.float32)
        self.observation_space = observation_space(body, senses)

    @property
    def colors(self) -> str:
        """Letters of the repertoire."""
        return self.task.colors

    @property
    def dt(self) -> float:
        """s, one control step."""
        return self.task.dt

    @abstractmethod
    def sense(self, name: str) -> np.ndarray:
        """One entry of an observation at this moment."""

    def observe(self) -> dict[str, np.ndarray]:
        """The observation at this moment; looking changes nothing."""
        return {name: self.sense(name) for name in self.observation_space}

    def lamp(self, state: TaskState) -> np.ndarray:
        """How far the task is, as a sense: float32 ``(1,)``."""
        return np.array([self.task.progress(state)], np.float32)

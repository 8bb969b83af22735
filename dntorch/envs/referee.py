"""Who says what a robot amid blocks has found, and what it earns: the judge and the task."""

import math
from typing import Any

import numpy as np
import torch

from dntorch.envs.judge import NOTHING, Judge, JudgeState, Verdict
from dntorch.envs.task import SequenceTask, TaskState


class Referee:
    """A `Judge` and a `SequenceTask` with their states, for one robot.

    Args:
        judge: tells which block was found.
        task: rewards the colours of the blocks in their order.

    Attributes:
        rewarded: state of the task.
    """

    def __init__(self, judge: Judge, task: SequenceTask) -> None:
        self.judge, self.task = judge, task

    def reset(self, bearings: np.ndarray, layout: np.ndarray) -> dict[str, Any]:
        """Begin; info of the first moment, in which nothing can be found."""
        self._judged, self.rewarded = JudgeState(), self.task.initial()
        seen, _ = self.judge.step(bearings, math.inf, self._judged)
        return _info(seen, layout, False)

    def step(
        self, bearings: np.ndarray, yaw_rate: float, layout: np.ndarray
    ) -> tuple[float, dict[str, Any]]:
        """Reward and info of one control step; ``layout`` tells the colour of each block."""
        verdict, self._judged = self.judge.step(bearings, yaw_rate, self._judged)
        found = torch.tensor(_color(verdict.found, layout))
        reward, completed, self.rewarded = self.task.step(found, self.rewarded)
        return float(reward), _info(verdict, layout, bool(completed))

    def snapshot(self) -> dict[str, tuple]:
        return {
            "judge": tuple(self._judged),
            "task": tuple(part.numpy().copy() for part in self.rewarded),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        self._judged = JudgeState(*snapshot["judge"])
        self.rewarded = TaskState(*(torch.from_numpy(part.copy()) for part in snapshot["task"]))


def _color(block: int, layout: np.ndarray) -> int:
    return NOTHING if block == NOTHING else int(layout[block])


def _info(seen: Verdict, layout: np.ndarray, completed: bool) -> dict[str, Any]:
    return {
        "found": np.int64(_color(seen.found, layout)),
        "completed": np.bool_(completed),
        "bearing": np.float64(seen.bearing),
        "centered": np.int64(_color(seen.centered, layout)),
    }

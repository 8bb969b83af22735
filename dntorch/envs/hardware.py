"""A robot as a Gymnasium environment, with the spaces of the simulated one."""

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch

from dntorch.body import EPUCK, Body
from dntorch.envs.senses import PROXIMITY_TABLE, SENSES
from dntorch.envs.sensors import two_speeds
from dntorch.envs.task import NOTHING, SequenceTask
from dntorch.envs.task_env import TaskEnv
from dntorch.quantities import check_quantities
from dntorch.robot.calibration import Calibration
from dntorch.robot.clock import Clock, RealClock
from dntorch.robot.contract import Frame, Robot
from dntorch.robot.images import resample
from dntorch.robot.safety import Guard, Limits


class HardwareEnv(TaskEnv):
    """Find colours with a robot that is really there, or emulated.

    Action and observation are those of ``EPuckEnv``: wheel speeds in rad/s; ``image``,
    ``wheels`` and ``proximity``, or those that ``senses`` names, a ``lamp`` too. Images are
    corrected and shown as the camera of ``body`` would see them, so that a block is as wide as the
    agent expects; what lies beyond the true camera's view is black. One step takes ``task.dt``
    seconds of the clock. Nobody knows the truth here, so there is no ``bearing``; what counts as
    found is what the agent reports, before the step, or a key press that is rewarded by itself.

    ============ ======== ===============================================================
    info         dtype    meaning
    ============ ======== ===============================================================
    found        int64    colour that was reported for this step (position) or -1
    completed    bool     this step completed the sequence
    fresh        bool     a new frame came since the last step
    age          float64  s since the newest frame came; infinite without a link
    late         float64  s by which this step ended too late: the jitter
    stopped      str      why the robot stands although nobody said so, or ""
    connections  int64    how often the link was made
    speeds       float64  rad/s, that were sent, ``(2,)``
    ============ ======== ===============================================================

    Use it in a ``with`` statement: then signals and the end of the program stop the robot
    too (see `Guard`). While frames are missing the last image is shown again and the robot
    stands; with the first fresh one it goes on.

    Args:
        robot: what to drive; it is put behind a `Guard`.
        clock: real time unless you say otherwise; the robot's.
        task: what is rewarded, and the length of one step.
        body: what the agent was made for: size and field of view of the image, speed cap.
        calibration: what the robot's camera is like.
        senses: names in the observation.
        limits: of the guard; the speed cap of ``body`` unless you say otherwise.
        key: asked once a step; true is rewarded like a completed sequence.
        patience: s to wait for the first frame.

    Raises:
        ConnectionError: no frame comes, or the link is lost and was not to be made anew.
        ValueError: an action of other than two finite numbers; the robot was stopped.
    """

    metadata: ClassVar = {"render_modes": []}

    def __init__(
        self,
        robot: Robot,
        clock: Clock | None = None,
        task: SequenceTask | None = None,
        *,
        body: Body = EPUCK,
        calibration: Calibration | None = None,
        senses: Sequence[str] = SENSES,
        limits: Limits | None = None,
        key: Callable[[], bool] = lambda: False,
        patience: float = 10.0,
    ) -> None:
        check_quantities(patience=patience)
        super().__init__(task, body, senses)
        self.patience = patience
        self.clock, self.calibration = clock or RealClock(), calibration or Calibration()
        self.guard = Guard(robot, self.clock, limits or Limits(speed=body.speed_cap))
        self.key, self._found, self._pressed = key, NOTHING, 0
        self._frame: Frame | None = None
        self._connected, self._ready = False, False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Stop, wait for a frame, and begin the task anew. The robot stays where it is."""
        super().reset(seed=seed)
        if not self._connected:
            self.guard.connect()
            self._connected = True
        self.guard.stop()
        self._wait()
        self._zero, self._rewarded = self._frame.steps, self.task.initial()
        self._found, self._pressed, self._ready = NOTHING, 0, True
        self._due = self.clock.now()
        return self.observe(), self._info((0.0, 0.0), NOTHING, False, True, 0.0)

    @property
    def frame(self) -> Frame:
        """The newest frame, as it came."""
        if self._frame is None:
            raise gymnasium.error.ResetNeeded("the robot is not ready: call reset() first")
        return self._frame

    def report(self, found: int) -> None:
        """Say which colour (position in ``colors``) the agent has found, for the next step."""
        if not 0 <= found < len(self.colors):
            raise ValueError(f"found={found!r}: give a position in colors={self.colors!r}")
        self._found = int(found)

    def step(self, action: np.ndarray):
        if not self._ready:
            raise gymnasium.error.ResetNeeded("the robot is not ready: call reset() first")
        speeds = self.guard.drive(*self._speeds(action))
        late = self._sleep()
        fresh = self._look()
        found, self._found = self._found, NOTHING
        reward, completed, self._rewarded = self.task.step(torch.tensor(found), self._rewarded)
        info = self._info(speeds, found, bool(completed), fresh, late)
        return self.observe(), max(float(reward), self._press()), False, False, info

    def close(self) -> None:
        """Stop the robot and give the link back."""
        self._ready = False
        if self._connected:
            self.guard.close()
            self._connected = False

    def __enter__(self) -> "HardwareEnv":
        self.guard.__enter__()
        self._connected = True
        return self

    def __exit__(self, *error) -> None:
        self._ready = self._connected = False
        self.guard.__exit__(*error)

    # ---------------------------------------------------------------- inside

    def _wait(self) -> None:
        end = self.clock.now() + self.patience
        while not self._look():
            if self.clock.now() >= end:
                raise ConnectionError(
                    f"no frame from the robot in {self.patience:g} s: is it on, near and free, and "
                    "are selector and protocol as docs/robot.md says?"
                )
            self.guard.drive(0.0, 0.0)  # speed 0 also asks for frames
            self.clock.sleep_until(self.clock.now() + self.dt)

    def _look(self) -> bool:
        """Take the newest frame; whether it is a new one."""
        frame, before = self.guard.frame, self._frame
        if frame is None or (before is not None and frame.number == before.number):
            return False
        if before is not None and frame.link != before.link:
            self._zero = self._zero + frame.steps - before.steps  # the wheels have not jumped
        self._frame = frame
        if "image" in self.observation_space.keys():
            self._image = self._as_agent_sees(frame.image)
        return True

    def _as_agent_sees(self, image: np.ndarray) -> np.ndarray:
        body, image = self.body, self.calibration.correct(image)
        tall, wide = image.shape[:2]
        across = math.tan(self.calibration.fov / 2) / math.tan(body.fov / 2)
        down = across * (tall / wide) / (body.height / body.width)
        return resample(image, body.width, body.height, (across, down))

    def _sleep(self) -> float:
        """Wait for the end of the step; how late it is."""
        self._due += self.dt
        self.clock.sleep_until(self._due)
        late = max(0.0, self.clock.now() - self._due)
        if late > self.dt:
            self._due = self.clock.now()  # lost time is not caught up in a hurry
        return late

    def _press(self) -> float:
        self._pressed = self.task.steps if self.key() else max(0, self._pressed - 1)
        return self.task.reward * (self._pressed > 0)

    def _speeds(self, action: np.ndarray) -> tuple[float, float]:
        speeds = two_speeds(action)
        if speeds is None:
            self.guard.stop()
            raise ValueError(f"action={action!r}: give two wheel speeds (left, right) in rad/s")
        return float(speeds[0]), float(speeds[1])

    def sense(self, name: str) -> np.ndarray:
        if name == "image":
            return self._image.copy()
        if name == "proximity":
            return self._frame.proximity.clip(0, PROXIMITY_TABLE[0][1]).astype(np.float32)
        if name == "lamp":
            return self.lamp(self._rewarded)
        return (self._frame.steps - self._zero).astype(np.float32)

    def _info(self, speeds, found: int, completed: bool, fresh: bool, late: float):
        return {
            "found": np.int64(found),
            "completed": completed,
            "fresh": fresh,
            "age": np.float64(self.guard.age),
            "late": np.float64(late),
            "stopped": self.guard.tripped or "",
            "connections": np.int64(self.guard.connections),
            "speeds": np.array(speeds, np.float64),
        }

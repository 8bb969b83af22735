"""What all Gymnasium envs of the ring of blocks share: the task, the judge, truth, snapshots."""

import colorsys
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np

from dntorch.body import EPUCK, STEPS_PER_TURN, Body
from dntorch.colors import HUES, check_missing
from dntorch.envs import sensors
from dntorch.envs.checks import check_episode, check_snapshot, check_whole
from dntorch.envs.drive import Drive, check_speeds
from dntorch.envs.judge import DWELL, DWELL_RATE, TOLERANCE, Judge
from dntorch.envs.layout import DAYLIGHT, Light, Ring, without
from dntorch.envs.pose import Pose
from dntorch.envs.referee import Referee
from dntorch.envs.senses import KNOWN, SENSES
from dntorch.envs.task import SequenceTask
from dntorch.envs.task_env import TaskEnv


class BlocksEnv(TaskEnv):
    """Find colours in the rewarded order by turning on the spot.

    The robot stands amid a ring of blocks. Action: speeds of the left and the right wheel
    in rad/s, clipped to ``body.speed_cap``. The task is continuing: never ``terminated``,
    and ``truncated`` only after ``max_seconds``.

    ============ ==================== ===================================================
    observation  type                 meaning
    ============ ==================== ===================================================
    image        uint8 (39, 52, 3)    RGB, row 0 at the top
    wheels       float32 (2,)         motor steps since the reset, left first, rounded to
                                      whole steps; 1000 per turn, no wrap-around
    proximity    float32 (8,)         infra-red readings ps0 ... ps7, near is large
    lamp         float32 (1,)         ``task.progress``, 0 to 1; only where ``senses`` names it
    ============ ==================== ===================================================

    ============ ======== ===============================================================
    info         dtype    meaning
    ============ ======== ===============================================================
    found        int64    colour that was found in this step (position in ``colors``) or -1
    completed    bool     this step completed the sequence
    bearing      float64  rad, of the nearest block seen from the camera, left is positive
    centered     int64    colour of the block within ``tolerance``, or -1
    yaw          float64  rad, true heading, in (-pi, pi]
    yaw_rate     float64  rad/s, true mean turning speed in this step
    ============ ======== ===============================================================

    The world judges what was found (:class:`~dntorch.envs.judge.Judge`) and rewards the
    sequence (:class:`~dntorch.envs.task.SequenceTask`); what an agent believes plays no part.
    A subclass sets ``_drive``, which moves the robot, and says how the world looks.

    Args:
        task: what is rewarded, and the length of one control step.
        ring: where the blocks stand; by default four of each colour.
        layout_seed: fixes the order of the colours; ``None``: ``reset(seed=)`` draws it.
        light, body: how all is lit; the robot and its camera.
        tolerance, dwell, dwell_rate: of the judge; rad, s, rad/s.
        senses: names in the observation; what is not named is not computed.
        render_mode: ``None`` or ``rgb_array``, a view from outside.
        max_seconds: ``None`` or the length of an episode in s.

    Raises:
        ValueError: an argument that makes no world; the sentence says what to give.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array"]}
    _drive: Drive

    def __init__(
        self,
        task: SequenceTask | None = None,
        ring: Ring | None = None,
        *,
        layout_seed: int | None = None,
        light: Light = DAYLIGHT,
        body: Body = EPUCK,
        tolerance: float = TOLERANCE,
        dwell: float = DWELL,
        dwell_rate: float = DWELL_RATE,
        senses: Sequence[str] = SENSES,
        render_mode: str | None = None,
        max_seconds: float | None = None,
    ) -> None:
        task, ring = check_whole(task, ring, light, body, tolerance)
        check_episode(layout_seed, render_mode, max_seconds)
        super().__init__(task, body, senses)
        self.ring, self.light, self.layout_seed = ring, light, layout_seed
        self.render_mode, self.max_seconds = render_mode, max_seconds
        self._referee = Referee(Judge(tolerance, dwell, dwell_rate, task.dt), task)
        # A snapshot may go on in an env that is sensed, drawn or cut off differently.
        self._world: dict[str, Any] = dict(
            task=task, ring=ring, layout_seed=layout_seed, light=light, body=body,
            tolerance=tolerance, dwell=dwell, dwell_rate=dwell_rate,
        )  # fmt: skip
        self._paints = np.array([colorsys.hsv_to_rgb(HUES[c] / 360, 1, 1) for c in task.colors])
        self._steps: int | None = None
        self._closed = False

    # ------------------------------------ image, proximity, view from outside: of a subclass

    @abstractmethod
    def _see(self) -> np.ndarray: ...

    @abstractmethod
    def _feel(self) -> np.ndarray: ...

    @abstractmethod
    def _draw(self, pose: Pose) -> np.ndarray: ...

    # ---------------------------------------------------------------- Gymnasium

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        fixed = self.layout_seed is not None
        random = np.random.default_rng(self.layout_seed) if fixed else self.np_random
        self._arrange(self.ring.draw(self.colors, random))
        self._drive.reset()
        self._pose, self._steps = self._drive.pose(), 0
        info = self._referee.reset(self.bearings, self.layout)
        return self.observe(), self._told(info, 0.0)

    def step(self, action: np.ndarray):
        reward, over, info = self.move(action)
        return self.observe(), reward, False, over, info

    def move(self, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        """`step` without an observation: reward, whether the time is over, info."""
        self._require_reset()
        before = self._pose.yaw
        self._drive.step(check_speeds(action, self.body.speed_cap))
        self._pose, self._steps = self._drive.pose(), self._steps + 1
        yaw_rate = math.remainder(self._pose.yaw - before, math.tau) / self.dt
        reward, info = self._referee.step(self.bearings, yaw_rate, self.layout)
        over = self.max_seconds is not None and self._steps * self.dt >= self.max_seconds
        return reward, over, self._told(info, yaw_rate)

    def take_away(self, missing: str) -> None:
        """From now to the next reset no block has these colours, as `Ring` says of ``missing``."""
        self._require_reset()
        check_missing(missing, "".join(self.colors[k] for k in np.unique(self.layout)))
        self._arrange(without(self.layout, missing, self.colors))

    def render(self) -> np.ndarray | None:
        """The view from outside, uint8 (360, 480, 3), RGB; ``None`` without a render mode."""
        return None if self.render_mode is None else self.view(self.pose)

    def view(self, pose: Pose) -> np.ndarray:
        """The view from outside, as in `render`, if the robot were at ``pose``."""
        self._require_reset()
        return self._draw(pose)

    def close(self) -> None:
        """This world has ended; a second call does nothing."""
        self._steps, self._closed = None, True

    # ---------------------------------------------------------------- truth

    @property
    def pose(self) -> Pose:
        """Where the robot truly is."""
        self._require_reset()
        return self._pose

    @property
    def bearings(self) -> np.ndarray:
        """rad, from the camera to the middle of each block k, of colour ``colors[layout[k]]``;
        left is positive, ``(blocks,)``."""
        return sensors.bearings(self.ring.centers, self.body, self._pose)

    def sense(self, name: str) -> np.ndarray:
        """One entry of an observation, also of those that ``senses`` does not name."""
        if name == "image":
            return self._see()
        if name == "proximity":
            return self._feel()
        if name == "wheels":
            return np.rint(self._drive.wheels * (STEPS_PER_TURN / math.tau)).astype(np.float32)
        if name == "lamp":
            return self.lamp(self._referee.rewarded)
        raise ValueError(f"name={name!r}: choose from {KNOWN}")

    # ---------------------------------------------------------------- snapshot

    def state_dict(self) -> dict[str, Any]:
        """A full snapshot that pickles; taking it changes nothing.

        An env built with the same arguments, in this or another process, that loads it
        goes on bit by bit like this one.
        """
        self._require_reset()
        return {
            "world": repr(self._world),
            "random": self.np_random.bit_generator.state,
            "layout": self.layout.copy(),
            "steps": self._steps,
            "drive": self._drive.snapshot(),
            **self._referee.snapshot(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a snapshot of :meth:`state_dict`.

        Raises:
            ValueError: the snapshot comes from an env with other arguments, or is damaged; the
                env is as it was.
        """
        check_snapshot(state, repr(self._world), type(self).__name__)
        before = None if self._steps is None else self.state_dict()
        try:
            self._restore(state)
        except gymnasium.error.Error:
            raise  # it was closed
        except Exception as error:
            if before is not None:
                self._restore(before)
            raise ValueError(
                f"the snapshot is damaged ({type(error).__name__}: {error}): give another"
            ) from error

    def _restore(self, state: dict[str, Any]) -> None:
        layout, steps = np.array(state["layout"]), int(state["steps"])
        if layout.shape != (self.ring.blocks,):
            raise ValueError(f"a layout of {layout.size} blocks")
        self.np_random.bit_generator.state = state["random"]
        self._arrange(layout)
        self._drive.restore(state["drive"])
        self._referee.restore(state)
        self._pose, self._steps = self._drive.pose(), steps

    # ---------------------------------------------------------------- inside

    def _require_reset(self) -> None:
        if self._steps is None:
            raise gymnasium.error.ResetNeeded("the world has not begun: call reset() first")

    def _arrange(self, layout: np.ndarray) -> None:
        if self._closed:
            raise gymnasium.error.ClosedEnvironmentError("this env was closed: build a new one")
        self.layout = layout

    def _told(self, info: dict[str, Any], yaw_rate: float) -> dict[str, Any]:
        return info | {"yaw": np.float64(self._pose.yaw), "yaw_rate": np.float64(yaw_rate)}

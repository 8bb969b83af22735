"""The world of the paper as a Gymnasium environment: an e-puck in a ring of coloured blocks."""

import colorsys
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from gymnasium import spaces

from dntorch.body import EPUCK, STEPS_PER_TURN, Body, check_positive
from dntorch.colors import HUES, PAPER, SEQUENCE, check_colors
from dntorch.envs import sensors
from dntorch.envs.drive import Free, Pin
from dntorch.envs.judge import DWELL, DWELL_RATE, NOTHING, TOLERANCE, Judge, JudgeState, Verdict
from dntorch.envs.layout import DAYLIGHT, Light, Ring
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene
from dntorch.envs.senses import SENSES
from dntorch.envs.spectator import Spectator
from dntorch.envs.task import REWARD, REWARD_DURATION, SequenceTask, TaskState

PIVOTS = ("free", "kinematic")


class EPuckEnv(gymnasium.Env):
    """Find colours in the rewarded order by turning on the spot.

    The robot stands amid a ring of blocks. Action: speeds of the left and the right wheel
    in rad/s, clipped to ``body.speed_cap``. The task is continuing: never ``terminated``,
    and ``truncated`` only after ``max_seconds``.

    ============ ==================== ===================================================
    observation  type                 meaning
    ============ ==================== ===================================================
    image        uint8 (39, 52, 3)    RGB, row 0 at the top
    wheels       float32 (2,)         motor steps since the reset, left first, rounded to
                                      whole steps; 1000 a turn, no wrap-around
    proximity    float32 (8,)         infra-red readings ps0 ... ps7, near is large
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

    Args:
        sequence, colors, reward, reward_duration: of the task; letters, size a step, s.
        dt: s, one control step.
        substeps: physics steps in one control step.
        blocks: how many; ``None`` for four of each colour. A multiple of the colours.
        block_size, block_shape, radius: m, ``box|cylinder|sphere|mixed``, m.
        layout_seed: fixes the order of the colours; ``None``: ``reset(seed=)`` draws it.
        light, body: the lamp; the robot and its camera.
        pivot: ``free`` on PyBullet's floor, or ``kinematic``, turning exactly on a pin.
        tolerance, dwell, dwell_rate: of the judge; rad, s, rad/s.
        senses: names in the observation; what is not named is not computed.
        render_mode: ``None`` or ``rgb_array``, a view from outside.
        max_seconds: ``None`` or the length of an episode in s.

    Raises:
        ValueError: an argument that makes no world; the sentence says what to give.
        ImportError: PyBullet is not installed.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 32}

    def __init__(
        self,
        *,
        sequence: str = SEQUENCE,
        colors: str = PAPER,
        reward: float = REWARD,
        reward_duration: float = REWARD_DURATION,
        dt: float = 1 / 32,
        substeps: int = 4,
        blocks: int | None = None,
        block_size: float = Ring.block_size,
        block_shape: str = Ring.block_shape,
        radius: float = Ring.radius,
        layout_seed: int | None = None,
        light: Light = DAYLIGHT,
        body: Body = EPUCK,
        pivot: str = "free",
        tolerance: float = TOLERANCE,
        dwell: float = DWELL,
        dwell_rate: float = DWELL_RATE,
        senses: Sequence[str] = SENSES,
        render_mode: str | None = None,
        max_seconds: float | None = None,
    ) -> None:
        blocks = 4 * len(check_colors(colors)) if blocks is None else blocks
        arguments = {k: v for k, v in locals().items() if k not in ("self", "__class__")}
        _check(**arguments)
        self.observation_space = sensors.observation_space(body, senses)
        self.body, self.dt, self.pivot = body, dt, pivot
        self.colors, self.layout_seed = colors, layout_seed
        self.render_mode, self.max_seconds = render_mode, max_seconds
        self.ring = Ring(blocks, radius, block_size, block_shape)
        self.judge = Judge(tolerance, dwell, dwell_rate, dt)
        self.task = SequenceTask(sequence, colors, reward, reward_duration, dt)
        # A snapshot may go on in an env that is sensed, drawn or cut off differently.
        del arguments["senses"]
        self._world = repr({**arguments, "render_mode": None, "max_seconds": None})
        self._light, self._spectator = light, None
        self._paints = np.array([colorsys.hsv_to_rgb(HUES[c] / 360, 1, 1) for c in colors])
        self._scene = Scene(self.ring, light)
        self._drive = Free(self._scene, body, dt, substeps) if pivot == "free" else Pin(body, dt)
        self._steps: int | None = None
        cap = body.speed_cap
        self.action_space = spaces.Box(-cap, cap, (2,), np.float32)

    # ---------------------------------------------------------------- Gymnasium

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        fixed = self.layout_seed is not None
        random = np.random.default_rng(self.layout_seed) if fixed else self.np_random
        each = self.ring.blocks // len(self.colors)
        self._arrange(random.permutation(np.repeat(np.arange(len(self.colors)), each)))
        self._drive.reset()
        self._pose, self._steps = self._drive.pose(), 0
        self._judged, self._rewarded = JudgeState(), self.task.initial()
        seen, _ = self.judge.step(self.bearings, math.inf, self._judged)
        return self.observe(), self._info(seen)

    def step(self, action: np.ndarray):
        reward, over, info = self.move(action)
        return self.observe(), reward, False, over, info

    def move(self, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        """`step` without an observation: reward, whether the time is over, info."""
        self._require_reset()
        before = self._pose.yaw
        self._drive.step(self._speeds(action))
        self._pose, self._steps = self._drive.pose(), self._steps + 1
        yaw_rate = math.remainder(self._pose.yaw - before, math.tau) / self.dt
        verdict, self._judged = self.judge.step(self.bearings, yaw_rate, self._judged)
        found = self._color(verdict.found)
        reward, completed, self._rewarded = self.task.step(torch.tensor(found), self._rewarded)
        over = self.max_seconds is not None and self._steps * self.dt >= self.max_seconds
        return float(reward), over, self._info(verdict, bool(completed), yaw_rate)

    def render(self) -> np.ndarray | None:
        """The view from outside, uint8 (360, 480, 3), RGB; ``None`` without a render mode."""
        return None if self.render_mode is None else self.view(self.pose)

    def view(self, pose: Pose) -> np.ndarray:
        """The view from outside, as in `render`, if the robot were at ``pose``."""
        self._require_reset()
        if self._spectator is None:
            self._spectator = Spectator(self.ring, self._light, self.body)
        return self._spectator.view(pose, self._paints[self.layout])

    def close(self) -> None:
        """Give both PyBullet clients back; a second call does nothing."""
        self._steps = None
        self._scene.close()
        if self._spectator is not None:
            self._spectator.close()

    # ---------------------------------------------------------------- truth

    @property
    def pose(self) -> Pose:
        """Where the robot truly is."""
        self._require_reset()
        return self._pose

    @property
    def bearings(self) -> np.ndarray:
        """rad, of every block's middle seen from the camera, left is positive, ``(blocks,)``.

        The colour of block ``k`` is ``colors[layout[k]]``.
        """
        return sensors.bearings(self.ring.centers, self.body, self._pose)

    def observe(self) -> dict[str, np.ndarray]:
        """The observation at this moment; looking changes nothing."""
        return {name: self.sense(name) for name in self.observation_space}

    def sense(self, name: str) -> np.ndarray:
        """One entry of an observation, also of those that ``senses`` does not name."""
        if name == "image":
            return sensors.image(self._scene, self.body, self._pose)
        if name == "proximity":
            return sensors.proximity(self._scene, self._pose)
        if name == "wheels":
            return np.rint(self._drive.wheels * (STEPS_PER_TURN / math.tau)).astype(np.float32)
        raise ValueError(f"name={name!r}: choose from {SENSES}")

    # ---------------------------------------------------------------- snapshot

    def state_dict(self) -> dict[str, Any]:
        """A full snapshot that pickles; taking it changes nothing.

        An env built with the same arguments, in this or another process, that loads it
        goes on bit by bit like this one.
        """
        self._require_reset()
        return {
            "world": self._world,
            "random": self.np_random.bit_generator.state,
            "layout": self.layout.copy(),
            "steps": self._steps,
            "drive": self._drive.snapshot(),
            "judge": tuple(self._judged),
            "task": tuple(part.numpy().copy() for part in self._rewarded),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a snapshot of :meth:`state_dict`.

        Raises:
            ValueError: the snapshot comes from an env with other arguments.
        """
        if state["world"] != self._world:
            raise ValueError(
                f"the snapshot is of another world: build EPuckEnv({state['world']}) to load it"
            )
        self.np_random.bit_generator.state = state["random"]
        self._arrange(state["layout"].copy())
        self._drive.restore(state["drive"])
        self._pose, self._steps = self._drive.pose(), state["steps"]
        self._judged = JudgeState(*state["judge"])
        self._rewarded = TaskState(*(torch.from_numpy(part.copy()) for part in state["task"]))

    # ---------------------------------------------------------------- inside

    def _require_reset(self) -> None:
        if self._steps is None:
            raise gymnasium.error.ResetNeeded("the world has not begun: call reset() first")

    def _arrange(self, layout: np.ndarray) -> None:
        if self._scene.closed:
            raise gymnasium.error.ClosedEnvironmentError("this env was closed: build a new one")
        self.layout = layout
        self._scene.paint(self._paints[layout])

    def _color(self, block: int) -> int:
        return NOTHING if block == NOTHING else int(self.layout[block])

    def _speeds(self, action: np.ndarray) -> np.ndarray:
        speeds = np.asarray(action, np.float64)
        if speeds.shape != (2,) or not np.isfinite(speeds).all():
            raise ValueError(
                f"action={action!r}: give two finite wheel speeds (left, right) in rad/s"
            )
        return speeds.clip(-self.body.speed_cap, self.body.speed_cap)

    def _info(self, seen: Verdict, completed: bool = False, yaw_rate: float = 0.0):
        return {
            "found": np.int64(self._color(seen.found)),
            "completed": np.bool_(completed),
            "bearing": np.float64(seen.bearing),
            "centered": np.int64(self._color(seen.centered)),
            "yaw": np.float64(self._pose.yaw),
            "yaw_rate": np.float64(yaw_rate),
        }


def _check(*, colors, dt, substeps, blocks, reward, reward_duration, tolerance, **others) -> None:
    """Raise a ``ValueError`` for the first argument that no other part would refuse."""
    seconds, seed = others["max_seconds"], others["layout_seed"]
    check_positive(dt=dt, substeps=substeps, blocks=blocks, tolerance=tolerance)
    check_positive(max_seconds=1.0 if seconds is None else seconds)
    modes, share, half = (None, "rgb_array"), len(colors), math.pi / blocks
    for name, value, good, remedy in (
        ("substeps", substeps, substeps == int(substeps), "give a whole number"),
        ("reward", reward, math.isfinite(reward), "give a finite number"),
        ("reward_duration", reward_duration, reward_duration >= dt, f"give {dt=} or more"),
        ("blocks", blocks, blocks % share == 0, f"give a multiple of the {share} colors"),
        ("layout_seed", seed, seed is None or seed >= 0, "give None or an integer from 0"),
        ("pivot", others["pivot"], others["pivot"] in PIVOTS, f"choose from {PIVOTS}"),
        ("tolerance", tolerance, tolerance < half, f"give less than half a pitch, {half:.3f}"),
        ("render_mode", others["render_mode"], others["render_mode"] in modes, "give 'rgb_array'"),
    ):
        if not good:
            raise ValueError(f"{name}={value!r} does not work: {remedy}")

"""The e-puck in its ring of blocks as a pure world in torch: many robots at once, no simulator."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.body import EPUCK, STEPS_PER_TURN, Body
from dntorch.envs.checks import check_whole
from dntorch.envs.judge import DWELL, DWELL_RATE, TOLERANCE, Judge, JudgeState
from dntorch.envs.layout import DAYLIGHT, Light, Ring
from dntorch.envs.ring_camera import RingCamera, wrap
from dntorch.envs.senses import check_senses
from dntorch.envs.task import NOTHING, SequenceTask, TaskState
from dntorch.envs.world import Outcome, World, check_action, individuals


class RingState(NamedTuple):
    wheels: Tensor
    """rad, both wheels since the start, left first, ``(*batch, 2)``; float64, since they grow"""
    layout: Tensor
    """position in the colours of each block's colour, ``(*batch, blocks)``, int64"""
    judge: JudgeState
    task: TaskState


class RingWorld(World[RingState]):
    """Find colours in the rewarded order by turning on the spot: `EPuckEnv` for a whole batch.

    The robot turns without slip on a pin in the middle of the ring, as that of
    ``EPuckEnv(pivot="kinematic")``, with the same layouts, light, images, judge and task.

    ============ ========================== =============================================
    observation  type                       meaning
    ============ ========================== =============================================
    image        uint8 (*batch, 39, 52, 3)  RGB, row 0 at the top; channels outermost in
                                            memory
    wheels       (*batch, 2)                motor steps since the start, left first,
                                            rounded to whole steps; 1000 per turn
    proximity    (*batch, 8)                infra-red readings ps0 ... ps7, near is large
    lamp         (*batch, 1)                ``task.progress``, 0 to 1
    ============ ========================== =============================================

    Bearings, wheel angles, distances and the depth of walls are differentiable; images of
    bytes, whole motor steps and what the judge says are not.

    Args:
        task: what is rewarded; its ``dt`` is one control step.
        ring: where the blocks stand; by default four of each colour. Boxes or cylinders.
        light, body: how all is lit; the robot and its camera.
        tolerance, dwell, dwell_rate: of the judge; rad, s, rad/s.
        senses: names in the observation; what is not named is not computed.
        dtype, device: of what is observed.

    Raises:
        ValueError: an argument that makes no world; the sentence says what to give.
    """

    def __init__(
        self,
        task: SequenceTask | None = None,
        ring: Ring | None = None,
        light: Light = DAYLIGHT,
        body: Body = EPUCK,
        tolerance: float = TOLERANCE,
        dwell: float = DWELL,
        dwell_rate: float = DWELL_RATE,
        senses: Sequence[str] = ("image",),
        dtype: torch.dtype = torch.float32,
        device: torch.device | str | None = None,
    ) -> None:
        task, self.ring = check_whole(task, ring, light, body, tolerance)
        check_senses(senses)
        self.task = task.to(device)
        self.judge = Judge(tolerance, dwell, dwell_rate, task.dt)
        self.light, self.body, self.senses = light, body, tuple(senses)
        self.camera = RingCamera(self.ring, light, body, task.colors, dtype, device)
        self.dtype, self.device = dtype, device

    @property
    def actions(self) -> tuple[int, float, float]:
        return 2, -self.body.speed_cap, self.body.speed_cap

    def initial(
        self, batch: Sequence[int] = (), seed: int | Tensor = 0, agents: int | Tensor = 0
    ) -> RingState:
        """At the start, before the robot has moved.

        Args:
            batch: shape of the batch of robots.
            seed: layouts are drawn for (seed, agent): those of ``EPuckEnv.reset(seed=seed)``
                for agent 0. One seed for all, or int64 ``(*batch,)``.
            agents: number of each robot, as ``seed``.
        """
        seed, agents = individuals(batch, seed, agents)
        batch = list(seed.shape)
        return RingState(
            torch.zeros([*batch, 2], dtype=torch.float64, device=self.device),
            self._layouts(batch, seed.cpu(), agents.cpu()),
            self.judge.initial(batch, self.device),
            self.task.initial(tuple(batch)),
        )

    def _layouts(self, batch: list[int], seed: Tensor, agents: Tensor) -> Tensor:
        pairs = torch.stack(torch.broadcast_tensors(seed, agents), -1).expand(*batch, 2)
        unique, member = pairs.reshape(-1, 2).unique(dim=0, return_inverse=True)
        drawn = [draw_layout(self.ring, self.task.colors, *pair) for pair in unique.tolist()]
        layouts = torch.tensor(drawn, dtype=torch.int64)[member].reshape(*batch, self.ring.blocks)
        return layouts.to(self.device)

    # ---------------------------------------------------------------- truth

    def yaw(self, state: RingState) -> Tensor:
        """rad, true heading, in [-pi, pi), ``(*batch,)``: the exact integral of the speeds."""
        return wrap(self.body.yaw_rate(*state.wheels.unbind(-1))).to(self.dtype)

    def pose(self, state: RingState) -> tuple[Tensor, Tensor, Tensor]:
        """x and y in metres and yaw in radians, each ``(*batch,)``."""
        yaw = self.yaw(state)
        return torch.zeros_like(yaw), torch.zeros_like(yaw), yaw

    def bearings(self, state: RingState) -> Tensor:
        """rad, of every block seen from the camera, left is positive, ``(*batch, blocks)``."""
        return self.camera.bearings(*self.pose(state))

    # ---------------------------------------------------------------- step

    def observe(self, state: RingState) -> dict[str, Tensor]:
        """The observation in a state."""
        pose = self.pose(state)
        return {name: self._sense(name, pose, state) for name in self.senses}

    def _sense(self, name: str, pose: tuple[Tensor, Tensor, Tensor], state: RingState) -> Tensor:
        if name == "image":
            return self.camera.image(self.camera.walls(*pose), state.layout)
        if name == "proximity":
            return self.camera.proximity(*pose)
        if name == "lamp":
            return self.task.progress(state.task).unsqueeze(-1).to(self.dtype)
        return (state.wheels * (STEPS_PER_TURN / math.tau)).round().to(self.dtype)

    def step(self, action: Tensor, state: RingState) -> tuple[Outcome, RingState]:
        """One control step under wheel speeds ``(*batch, 2)`` in rad/s, left first.

        Speeds are clipped to ``body.speed_cap``; NaN counts as 0.

        Raises:
            ValueError: speeds of another number or batch.
        """
        check_action("action", action, state.wheels.shape[:-1], 2, "give left and right of each")
        cap = self.body.speed_cap
        speeds = action.nan_to_num(0.0, cap, -cap).clamp(-cap, cap).to(torch.float64)
        rate = self.body.yaw_rate(*speeds.unbind(-1))
        moved = state._replace(wheels=state.wheels + speeds * self.task.dt)
        verdict, judge = self.judge.judge(self.bearings(moved), rate, state.judge)
        color = state.layout.gather(-1, verdict.found.clamp_min(0).unsqueeze(-1)).squeeze(-1)
        found = torch.where(verdict.found == NOTHING, NOTHING, color)
        reward, completed, task = self.task.step(found, state.task)
        moved = RingState(moved.wheels, state.layout, judge, task)
        return Outcome(self.observe(moved), reward, found, completed), moved


def draw_layout(ring: Ring, colors: str, seed: int, agent: int = 0) -> list[int]:
    """The position in ``colors`` of each block's colour, drawn by NumPy's default generator."""
    import numpy as np  # to draw what Gymnasium's seeding draws

    entropy = [seed, agent] if agent else seed
    return ring.draw(colors, np.random.default_rng(entropy)).tolist()

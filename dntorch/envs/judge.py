"""Who says that a colour was found: the world, from where the robot truly looks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from dntorch.envs.task import NOTHING
from dntorch.quantities import check_quantities

if TYPE_CHECKING:
    import numpy as np

TOLERANCE, DWELL, DWELL_RATE = math.radians(4), 0.5, 0.1
"""When a block is found, unless a world says otherwise: rad, s, rad/s; see `Judge`."""


class JudgeState(NamedTuple):
    """Of one robot; `Judge.judge` keeps tensors ``(*batch,)`` here, int64 and bool."""

    block: int = NOTHING
    """The block that is visited: the camera's axis is within its tolerance."""
    still: int = 0
    """Steps without a break in which the robot looked at it and hardly turned."""
    counted: bool = False
    """Whether this visit was already counted."""


class Verdict(NamedTuple):
    """On one robot; `Judge.judge` puts tensors ``(*batch,)`` here."""

    found: int
    """The block found in this step, or ``NOTHING``."""
    centered: int
    """The block within tolerance in this step, or ``NOTHING``."""
    bearing: float
    """rad, of the nearest block."""


class Judge:
    """Counts a block as found when the robot has come to rest before it.

    A block is *found* when its bearing has stayed within ``tolerance`` while the robot
    turned slower than ``dwell_rate`` for ``dwell`` seconds without a break. A visit counts
    once and ends when the bearing leaves the tolerance; a block that merely passes while
    the robot scans never counts. Blocks, not colours: the judge knows neither what the
    robot looks for nor what it believes.

    Args:
        tolerance: rad, largest bearing to either side.
        dwell: s.
        dwell_rate: rad/s.
        dt: s, one control step.

    Raises:
        ValueError: an argument is not positive and finite.
    """

    def __init__(
        self,
        tolerance: float = TOLERANCE,
        dwell: float = DWELL,
        dwell_rate: float = DWELL_RATE,
        dt: float = 1 / 32,
    ) -> None:
        check_quantities(tolerance=tolerance, dwell=dwell, dwell_rate=dwell_rate, dt=dt)
        self.tolerance, self.dwell_rate = tolerance, dwell_rate
        self.steps = max(1, round(dwell / dt))

    def step(
        self, bearings: np.ndarray, yaw_rate: float, state: JudgeState
    ) -> tuple[Verdict, JudgeState]:
        """One control step.

        Args:
            bearings: rad, of every block, 0 straight ahead, ``(blocks,)``.
            yaw_rate: rad/s.
            state: ``JudgeState()`` at first.
        """
        nearest = int(abs(bearings).argmin())
        bearing = float(bearings[nearest])
        if abs(bearing) > self.tolerance:
            return Verdict(NOTHING, NOTHING, bearing), JudgeState()
        _, still, counted = state if state.block == nearest else JudgeState()
        still = still + 1 if abs(yaw_rate) < self.dwell_rate else 0
        found = still >= self.steps and not counted
        verdict = Verdict(nearest if found else NOTHING, nearest, bearing)
        return verdict, JudgeState(nearest, still, counted or found)

    def initial(self, batch: list[int], device: torch.device | None = None) -> JudgeState:
        """At first, for `judge`."""
        none = torch.zeros(batch, dtype=torch.int64, device=device)
        return JudgeState(none + NOTHING, none, none > 0)

    def judge(
        self, bearings: Tensor, yaw_rate: Tensor, state: JudgeState
    ) -> tuple[Verdict, JudgeState]:
        """`step` for a batch: ``bearings`` are ``(*batch, blocks)``, ``yaw_rate`` ``(*batch,)``."""
        nearest = bearings.abs().argmin(-1)
        bearing = bearings.gather(-1, nearest.unsqueeze(-1)).squeeze(-1)
        centered = torch.where(bearing.abs() > self.tolerance, NOTHING, nearest)
        looked = centered != NOTHING
        stays = looked & (centered == state.block)
        slow = looked & (yaw_rate.abs() < self.dwell_rate)
        still = torch.where(slow, torch.where(stays, state.still, 0) + 1, 0)
        counted = stays & state.counted
        found = (still >= self.steps) & ~counted
        verdict = Verdict(torch.where(found, centered, NOTHING), centered, bearing)
        return verdict, JudgeState(centered, still, counted | found)

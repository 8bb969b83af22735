"""One run, as numbers: which world, which task, how long, with which parameters."""

import math
from dataclasses import dataclass

from dntorch.body import EPUCK
from dntorch.cells.integrators import check_integrator
from dntorch.checks import check_time_constant
from dntorch.colors import PAPER, SEQUENCE, check_colors, check_sequence
from dntorch.envs.task import REWARD, REWARD_DURATION

WORLDS = ("epuck", "nodes")


@dataclass(frozen=True)
class Config:
    """What a run depends on; the same config gives the same numbers.

    Raises:
        ValueError: a value that makes no run; the sentence says what to give.
    """

    world: str = "epuck"
    """``epuck``, the PyBullet world, or ``nodes``, the abstract one"""
    seed: int = 0
    """of layout, exploration and durations"""
    explore: int = 50_000
    """control steps of exploration, as in the paper"""
    steps: int = 100_000
    """control steps in all; the rest is exploitation"""
    sequence: str = SEQUENCE
    colors: str = PAPER
    dt: float = 1 / 32
    """s, a control step"""
    substeps: int = 1
    """integrator steps in a control step"""
    integrator: str = "euler"
    learning_rate: float = 0.06
    """1/s"""
    trace_tau: float = 1.0
    """s, time constant of the item-and-order memory"""
    reward: float = REWARD
    """size of the reward signal"""
    reward_duration: float = REWARD_DURATION
    """s, its length"""
    noise: float = 10.0
    """amplitude of exploration on the value weights"""
    width: int = EPUCK.width
    """px, of the camera image"""
    height: int = EPUCK.height
    """px"""

    def __post_init__(self) -> None:
        if self.world not in WORLDS:
            raise ValueError(f"world={self.world!r}: choose from {', '.join(WORLDS)}")
        check_sequence(self.sequence, check_colors(self.colors))
        check_integrator(self.integrator, self.substeps)
        for name in ("dt", "learning_rate", "trace_tau", "reward_duration", "noise"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}={getattr(self, name)} must be positive and finite")
        if not math.isfinite(self.reward):
            raise ValueError(f"reward={self.reward} is not finite: give a number")
        check_time_constant("trace_tau", self.trace_tau, self.fine)
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed={self.seed}: give a whole number from 0 to {2**32 - 1}")
        if min(self.width, self.height) < 1:
            raise ValueError(f"width={self.width}, height={self.height}: give an image of pixels")
        if self.steps < 1:
            raise ValueError(f"steps={self.steps}: run for at least one step")
        if not 0 <= self.explore <= self.steps:
            raise ValueError(
                f"explore={self.explore} is not within steps={self.steps}: explore for fewer steps "
                "or run for more"
            )

    @property
    def fine(self) -> float:
        """Seconds an integrator step."""
        return self.dt / self.substeps

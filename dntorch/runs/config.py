"""One run, as numbers: which world, which task, how long, with which parameters.

Imports no PyTorch: the command line makes its options of these fields.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from dntorch.body import EPUCK
from dntorch.cells.integrators import INTEGRATORS, check_integrator
from dntorch.colors import (
    HUES,
    PAPER,
    REWARD,
    REWARD_DURATION,
    SEQUENCE,
    check_colors,
    check_sequence,
)
from dntorch.runs.worlds import WORLDS


def _setting(default: Any, text: str, choices: tuple[str, ...] = ()) -> Any:
    """A field: its default, what it is in the words of ``--help``, and what it may be."""
    return field(default=default, metadata={"help": text, "choices": choices})


TEXT = "; ".join(f"{name}: {row.text}" for name, row in WORLDS.items()) + "."


@dataclass(frozen=True)
class Config:
    """What a run depends on; the same config gives the same numbers.

    Raises:
        ValueError: a value that makes no run; the sentence says what to give.
    """

    world: str = _setting("epuck", TEXT, tuple(WORLDS))
    seed: int = _setting(0, "Of layout, exploration and durations.")
    explore: int = _setting(50_000, "Control steps of exploration.")
    steps: int = _setting(100_000, "Control steps in all; the rest is exploitation.")
    sequence: str = _setting(SEQUENCE, "Colours that are rewarded in this order.")
    colors: str = _setting(PAPER, f"Colours to look for, of {''.join(HUES)}.")
    dt: float = _setting(1 / 32, "Duration of a control step, s.")
    substeps: int = _setting(1, "Integrator steps per control step.")
    integrator: str = _setting("euler", "Of the neural dynamics.", INTEGRATORS)
    learning_rate: float = _setting(0.06, "Of the values, 1/s.")
    trace_tau: float = _setting(1.0, "Time constant of the item-and-order memory, s.")
    reward: float = _setting(REWARD, "Size of the reward signal.")
    reward_duration: float = _setting(REWARD_DURATION, "Length of the reward signal, s.")
    noise: float = _setting(10.0, "Amplitude of exploration on the values.")
    width: int = _setting(EPUCK.width, "Columns of the camera image.")
    height: int = _setting(EPUCK.height, "Rows of the camera image.")

    def __post_init__(self) -> None:
        from dntorch.checks import check_time_constant  # imports PyTorch

        if self.world not in WORLDS:
            raise ValueError(f"world={self.world!r}: choose from {', '.join(WORLDS)}")
        check_sequence(self.sequence, check_colors(self.colors))
        check_integrator(self.integrator, self.substeps)
        for name in ("dt", "learning_rate", "trace_tau", "reward_duration", "noise"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name}={getattr(self, name)} must be positive and finite: give a number "
                    "above 0"
                )
        if not math.isfinite(self.reward):
            raise ValueError(f"reward={self.reward} is not finite: give a number")
        if self.reward_duration < self.dt:
            raise ValueError(
                f"reward_duration={self.reward_duration} is shorter than a control step: give at "
                f"least dt={self.dt}"
            )
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

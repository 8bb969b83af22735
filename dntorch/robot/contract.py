"""What a robot is: frames come from it, wheel speeds go to it."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np


class Frame(NamedTuple):
    """What a robot sensed at about one moment."""

    image: np.ndarray
    """uint8 ``(height, width, 3)``, RGB, row 0 at the top"""
    proximity: np.ndarray
    """float32 ``(8,)``, ps0 ... ps7, near is large"""
    steps: np.ndarray
    """int64 ``(2,)``, motor steps, left first, 1000 a turn; never wraps around"""
    time: float
    """s, of the clock, when its image had arrived, or earlier if nobody can know"""
    number: int
    """counts the frames"""
    link: int = 1
    """counts the links: with each ``steps`` begin anew"""


class Robot(Protocol):
    """A robot on two wheels with a camera, near or far, real or not."""

    def connect(self) -> None:
        """Make the link; the first word to the robot is speed 0."""

    @property
    def frame(self) -> Frame | None:
        """The newest frame of this connection."""

    @property
    def age(self) -> float:
        """s since the newest frame arrived, at most; infinite before the first."""

    @property
    def connections(self) -> int:
        """How often the link was made."""

    def drive(self, left: float, right: float) -> None:
        """Wheel speeds in rad/s; in force until the next."""

    def stop(self) -> None:
        """Speed 0, several times over. Never raises."""

    def close(self) -> None:
        """Stop and give the link back. Never raises."""


@runtime_checkable
class Watched(Protocol):
    """A robot that can be stopped when the process that drives it can not."""

    def watch(self, limit: float) -> None:
        """Stop by other means when no `drive` comes for ``limit`` s; call it before `connect`."""

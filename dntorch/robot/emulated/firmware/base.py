"""What the programs of all robots have in common."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from dntorch.robot.codecs import wifi

Look = Callable[[], np.ndarray | None]
"""Takes the next image, RGB; ``None`` while the camera has no new one."""

Feel = Callable[[], wifi.Sensors]
"""Reads the sensors."""


class Firmware(Protocol):
    """One robot's program."""

    speeds: tuple[int, int]
    """motor steps/s that are in force"""
    counters: tuple[int, int] | None
    """what the host wants the step counters to show from now on"""
    calibrations: int
    """how often the host asked to calibrate the infra-red sensors"""

    def take(self, data: bytes) -> None:
        """What the host said."""

    def give(self, look: Look, feel: Feel) -> list[bytes]:
        """Packets that are sent now."""

    def greet(self) -> None:
        """A host has come. The last speed stays in force."""

    def farewell(self) -> bool:
        """The host has gone; whether the robot takes notice and ends the link."""


def clip(speeds: tuple[int, int], limit: int) -> tuple[int, int]:
    left, right = (min(max(speed, -limit), limit) for speed in speeds)
    return left, right

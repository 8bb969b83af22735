"""Where a robot is in a world."""

import math
from typing import NamedTuple

import numpy as np


class Pose(NamedTuple):
    """Where a robot is."""

    position: np.ndarray
    """m, of the robot's frame, ``(3,)``"""
    rotation: np.ndarray
    """from the robot's frame to the world's, ``(3, 3)``"""

    @property
    def yaw(self) -> float:
        """rad, counter-clockwise from the world's x axis, in (-pi, pi]"""
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

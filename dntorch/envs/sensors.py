"""What the e-puck senses of a scene: a camera image, eight proximity readings, bearings.

Numbers follow ``E-puck.proto`` and ``e-puck.md`` of Webots (Cyberbotics).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from dntorch.body import Body
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene
from dntorch.envs.senses import (
    PROXIMITY_RANGE,
    PROXIMITY_SENSORS,
    PROXIMITY_TABLE,
    check_senses,
)

FARTHEST = 2.0**24
"""Motor steps that float32 still counts one by one: 23 hours at the speed cap."""


def two_speeds(action: Any) -> np.ndarray | None:
    """Wheel speeds (left, right) as float64; None for what is no two numbers."""
    try:
        speeds = np.asarray(action, np.float64)
    except (TypeError, ValueError):
        return None
    return speeds if speeds.shape == (2,) else None


def observation_space(body: Body, senses: Sequence[str]) -> spaces.Dict:
    """The space of observations that hold ``senses`` alone, for a robot with this body."""
    known = {
        "image": spaces.Box(0, 255, (body.height, body.width, 3), np.uint8),
        "wheels": spaces.Box(-FARTHEST, FARTHEST, (2,), np.float32),
        "proximity": spaces.Box(0, PROXIMITY_TABLE[0][1], (8,), np.float32),
        "lamp": spaces.Box(0, 1, (1,), np.float32),
    }
    check_senses(senses)
    return spaces.Dict({name: known[name] for name in senses})


def proximity_reading(distance: np.ndarray) -> np.ndarray:
    """Readings, float32, for ``distance`` in metres."""
    return np.interp(distance, *np.transpose(PROXIMITY_TABLE)).astype(np.float32)


def image(scene: Scene, body: Body, pose: Pose) -> np.ndarray:
    """What the camera sees, uint8 ``(height, width, 3)``, RGB, row 0 at the top."""
    eye = pose.position + pose.rotation @ body.camera
    ahead, _, up = pose.rotation.T
    size = body.width, body.height
    return scene.photograph(eye, eye + ahead, up, size, body.fov, body.near)


def proximity(scene: Scene, pose: Pose) -> np.ndarray:
    """Readings of ps0 ... ps7, float32 ``(8,)``; the nearer an obstacle, the larger."""
    places, angles = np.split(np.array(PROXIMITY_SENSORS), [3], axis=1)
    angles = angles[:, 0]
    ways = np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1)
    starts = pose.position + places @ pose.rotation.T
    return proximity_reading(scene.distances(starts, ways @ pose.rotation.T, PROXIMITY_RANGE))


def bearings(targets: np.ndarray, body: Body, pose: Pose) -> np.ndarray:
    """rad, from the camera's axis to every target ``(n, 2)`` in metres; left is positive.

    The truth, which no sensor of the robot delivers.
    """
    across, along = np.flip(targets - (pose.position + pose.rotation @ body.camera)[:2], 1).T
    return np.remainder(np.arctan2(across, along) - pose.yaw + math.pi, math.tau) - math.pi

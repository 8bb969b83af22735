"""What the e-puck senses of a scene: a camera image, eight proximity readings, bearings.

Numbers follow ``E-puck.proto``, ``E-puckDistanceSensor.proto`` and ``e-puck.md`` of Webots
(Cyberbotics).
"""

import math
from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from dntorch.body import Body
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene

SENSES = ("image", "wheels", "proximity")
"""Names in an observation."""

FARTHEST = 2.0**24
"""Motor steps that float32 still counts one by one: 23 hours at the speed cap."""

#: Eight infra-red sensors ps0 ... ps7, clockwise from the front right:
#: x, y, z in metres and direction in radians from straight ahead.
PROXIMITY_SENSORS = np.array([
    (0.030, -0.010, 0.033, 1.27 - math.pi / 2),
    (0.022, -0.025, 0.033, 0.77 - math.pi / 2),
    (0.000, -0.031, 0.033, 0.00 - math.pi / 2),
    (-0.030, -0.015, 0.033, 5.21 - math.pi / 2),
    (-0.030, 0.015, 0.033, 4.21 - math.pi / 2),
    (0.000, 0.031, 0.033, math.pi / 2),
    (0.022, 0.025, 0.033, 2.37 - math.pi / 2),
    (0.030, 0.010, 0.033, 1.87 - math.pi / 2),
])  # fmt: skip

#: What a sensor reads at a distance: metres, reading without noise.
PROXIMITY_TABLE = np.array([
    (0.000, 4095.00), (0.005, 2133.33), (0.010, 1465.73), (0.015, 601.46), (0.020, 383.84),
    (0.030, 234.93), (0.040, 158.03), (0.050, 120.00), (0.060, 104.09), (0.070, 67.19),
])  # fmt: skip

#: Reach of a proximity sensor in metres; beyond it the reading is that at its end.
PROXIMITY_RANGE = float(PROXIMITY_TABLE[-1, 0])


def observation_space(body: Body, senses: Sequence[str]) -> spaces.Dict:
    """The space of observations that hold ``senses`` alone, for a robot with this body."""
    known = {
        "image": spaces.Box(0, 255, (body.height, body.width, 3), np.uint8),
        "wheels": spaces.Box(-FARTHEST, FARTHEST, (2,), np.float32),
        "proximity": spaces.Box(0, PROXIMITY_TABLE[0, 1], (8,), np.float32),
    }
    for name in senses:
        if name not in known:
            raise ValueError(
                f"senses={senses!r}: {name!r} is unknown, give a tuple out of {SENSES}"
            )
    return spaces.Dict({name: known[name] for name in senses})


def proximity_reading(distance: np.ndarray) -> np.ndarray:
    """Readings, float32, for ``distance`` in metres."""
    return np.interp(distance, *PROXIMITY_TABLE.T).astype(np.float32)


def image(scene: Scene, body: Body, pose: Pose) -> np.ndarray:
    """What the camera sees, uint8 ``(height, width, 3)``, RGB, row 0 at the top."""
    eye = pose.position + pose.rotation @ body.camera
    ahead, _, up = pose.rotation.T
    size = body.width, body.height
    return scene.photograph(eye, eye + ahead, up, size, body.fov, body.near)


def proximity(scene: Scene, pose: Pose) -> np.ndarray:
    """Readings of ps0 ... ps7, float32 ``(8,)``; the nearer an obstacle, the larger."""
    places, angles = PROXIMITY_SENSORS[:, :3], PROXIMITY_SENSORS[:, 3]
    ways = np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1)
    starts = pose.position + places @ pose.rotation.T
    return proximity_reading(scene.distances(starts, ways @ pose.rotation.T, PROXIMITY_RANGE))


def bearings(targets: np.ndarray, body: Body, pose: Pose) -> np.ndarray:
    """rad, from the camera's axis to every target ``(n, 2)`` in metres; left is positive.

    The truth, which no sensor of the robot delivers.
    """
    across, along = np.flip(targets - (pose.position + pose.rotation @ body.camera)[:2], 1).T
    return np.remainder(np.arctan2(across, along) - pose.yaw + math.pi, math.tau) - math.pi

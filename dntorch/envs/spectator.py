"""The view from outside: the ring and a robot drawn for people."""

import numpy as np

from dntorch.body import Body
from dntorch.envs.layout import Light, Ring
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene

WHITE, DARK = (0.9, 0.9, 0.9, 1), (0.12, 0.12, 0.14, 1)
GREEN, ORANGE = (0.3, 0.5, 0.35, 1), (1.0, 0.5, 0.0, 1)


class Spectator:
    """A second scene with the same blocks and a robot to look at.

    A client of its own: nothing that is drawn here can touch the physics or the camera.

    Args:
        ring, light: those of the world.
        body: the robot that is drawn.
    """

    def __init__(self, ring: Ring, light: Light, body: Body) -> None:
        self.scene, self.reach = Scene(ring, light), ring.radius
        self.parts = [
            (self.scene.place(self.scene.shape(kind, size, color), place), np.array(place))
            for kind, size, place, color in self._robot(body)
        ]

    @staticmethod
    def _robot(body: Body):
        """Kind, size, place in the robot's frame and colour of every part; metres."""
        width, r, height = 2 * body.radius, body.wheel_radius, 0.05
        return [
            ("cylinder", (width, width, 0.026), (0, 0, 0.027), GREEN),
            ("cylinder", (width, width, 0.008), (0, 0, 0.044), DARK),
            ("box", (2 * r, 0.004, 2 * r), (0, body.axle / 2 + 0.009, r), DARK),
            ("box", (2 * r, 0.004, 2 * r), (0, -body.axle / 2 - 0.009, r), DARK),
            ("box", (0.012, 0.014, 0.016), (body.radius, 0, body.camera[2]), DARK),
            ("box", (0.8 * body.radius, 0.012, 0.004), (0.55 * body.radius, 0, height), ORANGE),
            ("cylinder", (0.02, 0.02, 0.004), (-0.3 * body.radius, 0, height), WHITE),
        ]

    def view(self, pose: Pose, colors: np.ndarray, size: tuple[int, int] = (480, 360)):
        """Picture of the whole ring from behind and above, uint8 ``(height, width, 3)``.

        ``size`` is (width, height) in pixels, ``colors`` as in :meth:`Scene.paint`.
        """
        self.scene.paint(colors)
        for part, place in self.parts:
            self.scene.move(part, pose.position + pose.rotation @ place, pose.yaw)
        eye = self.reach * np.array((-2.0, 0.0, 2.4))
        target = (-0.12 * self.reach, 0, 0)
        return self.scene.photograph(eye, target, (0, 0, 1), size, fov=0.84, near=0.1)

    def close(self) -> None:
        self.scene.close()

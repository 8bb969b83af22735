"""The view from outside without a simulator: the ring and a robot, drawn from above."""

import numpy as np

from dntorch.body import Body
from dntorch.envs.layout import Ring
from dntorch.envs.pose import Pose

FLOOR, SIGHT = (0.50, 0.50, 0.50), (0.62, 0.62, 0.62)
HULL, DARK, ORANGE = (0.30, 0.50, 0.35), (0.12, 0.12, 0.14), (1.0, 0.5, 0.0)


class RingView:
    """Pictures of the whole ring from above: yaw 0 is up, left is left.

    Edges are smooth: a pixel is covered as far as its middle lies inside, in pixels.

    Args:
        ring, body: of the world; the robot is drawn with its wheels and what its camera sees.
        size: width and height in pixels.
    """

    def __init__(self, ring: Ring, body: Body, size: tuple[int, int] = (480, 360)) -> None:
        width, height = size
        self.ring, self.body = ring, body
        self.pixel = 2.2 * (ring.radius + ring.block_size) / min(size)
        row, column = np.mgrid[:height, :width].astype(np.float32)
        self.x = ((height - 1) / 2 - row) * self.pixel
        self.y = ((width - 1) / 2 - column) * self.pixel
        self._blocks = self._each_block()

    def view(self, pose: Pose, colors: np.ndarray) -> np.ndarray:
        """uint8 ``(height, width, 3)``, RGB; ``colors`` of each block ``(blocks, 3)``, 0 to 1."""
        picture = np.full((*self.x.shape, 3), FLOOR, np.float32)
        sight = self._sight(pose)
        _lay(picture, sight, SIGHT)
        for (rows, columns, cover), color in zip(self._blocks, colors, strict=True):
            _lay(picture[rows, columns], cover, color)
        x, y = self._seen_from(pose)
        body, r = self.body, self.body.wheel_radius
        for side in (-1, 1):
            _lay(picture, self._box(x, y - side * body.axle / 2, r, 0.004), DARK)
        _lay(picture, self._disc(x, y, body.radius), HULL)
        _lay(picture, self._box(x - 0.55 * body.radius, y, 0.4 * body.radius, 0.006), ORANGE)
        return np.rint(255 * picture).astype(np.uint8)

    def _each_block(self) -> list[tuple[slice, slice, np.ndarray]]:
        """Where in the picture a block is, and how far it covers each pixel there."""
        half, blocks = self.ring.block_size / 2, []
        for (cx, cy), angle in zip(self.ring.centers, self.ring.angles, strict=True):
            near = np.hypot(self.x - cx, self.y - cy) < 1.5 * half + 2 * self.pixel
            rows, columns = (np.flatnonzero(near.any(axis)) for axis in (1, 0))
            part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            x, y = self.x[part] - cx, self.y[part] - cy
            c, s = np.cos(angle), np.sin(angle)
            boxes = self.ring.block_shape == "box"
            along = x * c + y * s, y * c - x * s
            cover = self._box(*along, half, half) if boxes else self._disc(x, y, half)
            blocks.append((*part, cover))
        return blocks

    def _seen_from(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        x, y = self.x - pose.position[0], self.y - pose.position[1]
        c, s = np.cos(pose.yaw), np.sin(pose.yaw)
        return x * c + y * s, y * c - x * s

    def _sight(self, pose: Pose) -> np.ndarray:
        """What the camera sees, up to the blocks."""
        ahead, aside, _ = self.body.camera
        x, y = self._seen_from(pose)
        x, y = x - ahead, y - aside
        half = self.body.fov / 2
        inside = np.sin(half) * x - np.cos(half) * abs(y)
        far = self.ring.radius - np.hypot(self.x, self.y)
        return self._cover(np.minimum(inside, far))

    def _box(self, x: np.ndarray, y: np.ndarray, long: float, wide: float) -> np.ndarray:
        return self._cover(np.minimum(long - abs(x), wide - abs(y)))

    def _disc(self, x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
        return self._cover(radius - np.hypot(x, y))

    def _cover(self, inside: np.ndarray) -> np.ndarray:
        return (0.5 + inside / self.pixel).clip(0, 1)[..., None]


def _lay(picture: np.ndarray, cover: np.ndarray, color) -> None:
    """Put a colour over a picture, in place."""
    picture += cover * (np.asarray(color, np.float32) - picture)

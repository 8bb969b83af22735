r"""What a camera sees of a ring of blocks, by casting one ray through each column of the image.

All blocks have one height and the camera is below their tops, so the nearest wall of a column
decides the whole column: background above it, floor below it. A pixel of TinyRenderer, the
software renderer of PyBullet, is the scene at its integer column and row, not at its middle:

.. math:: u_c = (W/2 - c) / f, \qquad v_r = (H/2 - 1 - r) / f

are its slopes to the left and upwards. Colours: `dntorch.envs.shading`.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.body import Body
from dntorch.envs import raycast
from dntorch.envs.layout import Light, Ring
from dntorch.envs.senses import (
    PROXIMITY_RANGE,
    PROXIMITY_SENSORS,
    PROXIMITY_TABLE,
    proximity_reading,
)
from dntorch.envs.shading import Shading

#: m, half width of the floor; brightness of what is behind it.
FLOOR, BACKGROUND = 1.5, 255


class Walls(NamedTuple):
    """What stands behind each column of an image."""

    depth: Tensor
    """m, along the camera's axis; infinite where no wall is, ``(*batch, width)``"""
    block: Tensor
    """number of the block, int64, ``(*batch, width)``; any where no wall is"""
    diffuse: Tensor
    """cosine between wall and lamp, 0 or more, ``(*batch, width)``"""
    floor: Tensor
    """m, along the axis to the end of the floor, ``(*batch, width)``"""


class RingCamera:
    """A camera and eight proximity sensors in a ring, for robots at any pose.

    Poses are tensors ``(*batch,)``: x and y in metres from the middle, yaw in radians.

    Args:
        ring, light, body: as those of the simulated robot.
        colors: letters of the paints.
        dtype, device: of poses and distances.

    Raises:
        ValueError: a ring or a light that rays of columns can't show.
    """

    def __init__(
        self,
        ring: Ring,
        light: Light,
        body: Body,
        colors: str,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str | None = None,
    ) -> None:
        _check(ring, light, body)
        self.ring, self.light, self.body = ring, light, body

        def tensor(values) -> Tensor:
            return torch.tensor(values, dtype=dtype, device=device)

        turn = [(k + 0.5) * math.tau / ring.blocks for k in range(ring.blocks)]
        self.turn = tensor(turn)
        self.facing = tensor([[math.cos(k) for k in turn], [math.sin(k) for k in turn]])
        self.centers = ring.radius * self.facing
        self.slope = (body.width / 2 - torch.arange(body.width).to(self.turn)) / body.focal
        whole = torch.uint8 if body.height < 256 else torch.int16
        self.row = torch.arange(body.height, dtype=whole, device=device).unsqueeze(-1)
        self.shading = Shading(light, colors, tensor)
        self.floor = self.shading.floor.to(whole)[:, None, None]
        self.sensors, self.table = tensor(PROXIMITY_SENSORS), tensor(PROXIMITY_TABLE)

    # ---------------------------------------------------------------- camera

    def walls(self, x: Tensor, y: Tensor, yaw: Tensor) -> Walls:
        """The nearest wall behind each column of the image; differentiable but for its block."""
        eye, heading = self._moved(x, y, yaw, *self.body.camera[:2])
        c, front = self._from_blocks(eye, heading)
        half, slope = self.ring.block_size / 2, self.slope
        rays = _rays(front[0].unsqueeze(-1), front[1].unsqueeze(-1), slope)
        middles = c[0].unsqueeze(-1), c[1].unsqueeze(-1)
        boxes = self.ring.block_shape == "box"
        if boxes:
            entry = raycast.box_entry(middles, rays, half)
        else:
            turn = (yaw.unsqueeze(-1) - self.turn).unsqueeze(-1) + slope.atan()
            entry = raycast.disc_entry(middles, rays, half, raycast.drum_reach(turn, half))
        depth, block = entry.min(-2)
        # From here on only the block that is seen in each column.
        c, front = _of(c, block), _of(front, block)
        d = _rays(*front, slope)
        if boxes:
            normal = raycast.box_normal(c, d, half)
        else:
            drum = raycast.drum_entry(c, d, half)
            depth = torch.where(depth < math.inf, drum, depth)
            normal = (drum * d[0] - c[0]) / half, (drum * d[1] - c[1]) / half
        return Walls(depth, block, self._diffuse(normal, block), self._floor(eye, heading))

    def image(self, walls: Walls, layout: Tensor) -> Tensor:
        """The image, RGB, uint8 ``(*batch, height, width, 3)``, row 0 at the top.

        It is drawn with the channels outermost in memory. ``layout`` holds the colour of each
        block, int64 ``(*batch, blocks)``.
        """
        low, top = self._edges(walls)
        # One tensor of bytes: what follows is done for each pixel, what came before is not.
        column = torch.cat((top, low, self._color(walls, layout).movedim(-1, -2)), -2)
        top, low, color = column.unsqueeze(-2).split([1, 1, 3], -3)
        below = torch.where(self.row < low, color, self.floor)
        return torch.where(self.row < top, BACKGROUND, below).to(torch.uint8).movedim(-3, -1)

    def _edges(self, walls: Walls) -> tuple[Tensor, Tensor]:
        """The first row below the wall and the first of the wall, ``(*batch, 1, width)``."""
        height, focal, eye = self.body.height, self.body.focal, self.body.camera[2]
        seen, horizon = walls.depth < math.inf, height / 2 - 1
        ground = torch.where(seen, walls.depth, walls.floor)
        low = (horizon + eye * focal / ground).floor() + 1
        top = (horizon - (self.ring.block_size - eye) * focal / walls.depth).ceil()
        edges = low, torch.where(seen, top, low)
        return tuple(edge.clamp(0, height).to(self.row.dtype).unsqueeze(-2) for edge in edges)

    def _color(self, walls: Walls, layout: Tensor) -> Tensor:
        paint = layout.gather(-1, walls.block)
        return self.shading.walls(paint, walls.diffuse).to(self.row.dtype)

    def _diffuse(self, normal: tuple[Tensor, Tensor], block: Tensor) -> Tensor:
        lamp, (along, across) = self.shading.lamp, self.facing
        lamp = (
            lamp[0] * along + lamp[1] * across,
            lamp[1] * along - lamp[0] * across,
        )
        return (normal[0] * lamp[0][block] + normal[1] * lamp[1][block]).clamp_min(0)

    def _floor(self, eye: tuple[Tensor, Tensor], heading: tuple[Tensor, Tensor]) -> Tensor:
        rays = _rays(heading[0].unsqueeze(-1), heading[1].unsqueeze(-1), self.slope)
        middle = -eye[0].unsqueeze(-1), -eye[1].unsqueeze(-1)
        return raycast.box_faces(middle, rays, FLOOR)[2]

    # ---------------------------------------------------------------- other senses

    def distances(self, x: Tensor, y: Tensor, yaw: Tensor) -> Tensor:
        """m, how far each proximity sensor sees, at most its reach, ``(*batch, 8)``."""
        ahead, aside, _, angle = self.sensors.unbind(-1)
        x, y, yaw = x.unsqueeze(-1), y.unsqueeze(-1), yaw.unsqueeze(-1)
        place, _ = self._moved(x, y, yaw, ahead, aside)
        yaw, half = yaw + angle, self.ring.block_size / 2
        c, d = self._from_blocks(place, (yaw.cos(), yaw.sin()))
        boxes = self.ring.block_shape == "box"
        entry = raycast.box_entry(c, d, half) if boxes else raycast.disc_entry(c, d, half, half)
        return entry.amin(-1).clamp_max(PROXIMITY_RANGE)

    def proximity(self, x: Tensor, y: Tensor, yaw: Tensor) -> Tensor:
        """Readings of ps0 ... ps7, ``(*batch, 8)``; the nearer an obstacle, the larger."""
        return proximity_reading(self.distances(x, y, yaw), self.table)

    def bearings(self, x: Tensor, y: Tensor, yaw: Tensor) -> Tensor:
        """rad, of every block's middle seen from the camera, left positive, ``(*batch, blocks)``.

        The truth, which no sensor of the robot delivers.
        """
        eye, _ = self._moved(x, y, yaw, *self.body.camera[:2])
        along, across = (c - e.unsqueeze(-1) for c, e in zip(self.centers, eye, strict=True))
        return wrap(torch.atan2(across, along) - yaw.unsqueeze(-1))

    # ---------------------------------------------------------------- inside

    def _moved(self, x, y, yaw, ahead, aside):
        """A place on the robot in the world, and the heading of the robot."""
        cos, sin = yaw.cos(), yaw.sin()
        return (x + cos * ahead - sin * aside, y + sin * ahead + cos * aside), (cos, sin)

    def _from_blocks(self, place, heading):
        """Each block's middle seen from a place, and a heading, in coordinates of that block."""
        x, y = (c - p.unsqueeze(-1) for c, p in zip(self.centers, place, strict=True))
        cos, sin = heading[0].unsqueeze(-1), heading[1].unsqueeze(-1)
        along, across = self.facing
        middle = x * along + y * across, y * along - x * across
        return middle, (cos * along + sin * across, sin * along - cos * across)


def wrap(angle: Tensor) -> Tensor:
    """The same angle in [-pi, pi), rad."""
    return angle - math.tau * ((angle + math.pi) / math.tau).floor()


def _rays(cos, sin, slope: Tensor) -> tuple[Tensor, Tensor]:
    """Directions of columns, one long along the axis of a camera with this heading."""
    return cos - sin * slope, sin + cos * slope


def _of(pair: tuple[Tensor, Tensor], block: Tensor) -> tuple[Tensor, Tensor]:
    return pair[0].gather(-1, block), pair[1].gather(-1, block)


def _check(ring: Ring, light: Light, body: Body) -> None:
    """Raise a ``ValueError`` for what one ray per column can't show."""
    highest = max(body.camera[2], *(sensor[2] for sensor in PROXIMITY_SENSORS))
    if ring.block_shape not in ("box", "cylinder"):
        raise ValueError(
            f"block_shape={ring.block_shape!r}: a ball is not one wall per column; "
            "give 'box' or 'cylinder', or take EPuckEnv"
        )
    if light.shadow:
        raise ValueError("shadow=True: rays of columns cast none; give False, or take EPuckEnv")
    if ring.block_size <= highest:
        raise ValueError(
            f"block_size={ring.block_size!r}: sensors at {highest} m would look over the blocks; "
            "give a larger size, or take EPuckEnv"
        )

r"""Where rays in the plane first meet a box or a drum.

A ray is :math:`p(t) = t\,d`, seen from its start; what it meets has its middle at
:math:`c` (metres from the start of the ray). All coordinates here are those of the block: x
points along its facing, away from the middle of the ring. Every function is elementwise, so
that shapes only have to broadcast, and differentiable where a ray stays on one face.

A wall that a ray misses is infinitely far away.
"""

import math

import torch
from torch import Tensor

#: Flat sides of a drum, PyBullet's picture of a cylinder (`dntorch.envs.scene.drum`).
SIDES = 24


def box_faces(c: tuple[Tensor, Tensor], d: tuple[Tensor, Tensor], half: float):
    """Entry into the two slabs ``|x| <= half`` and ``|y| <= half``, and exit from the box."""
    (near_x, far_x), (near_y, far_y) = _slab(c[0], d[0], half), _slab(c[1], d[1], half)
    return near_x, near_y, torch.minimum(far_x, far_y)


def _slab(c: Tensor, d: Tensor, half: float) -> tuple[Tensor, Tensor]:
    """Entry and exit; a ray along the slab is in it, or outside of it, all the way."""
    inverse = d.reciprocal()
    one, other = (c - half) * inverse, (c + half) * inverse
    return torch.minimum(one, other), torch.maximum(one, other)


def box_entry(c: tuple[Tensor, Tensor], d: tuple[Tensor, Tensor], half: float) -> Tensor:
    """``t`` at which a ray enters a square box of half width ``half`` (m) from outside."""
    first, second, leave = box_faces(c, d, half)
    enter = torch.maximum(first, second)
    return torch.where((enter <= leave) & (enter > 0), enter, math.inf)


def box_normal(c: tuple[Tensor, Tensor], d: tuple[Tensor, Tensor], half: float):
    """Normal (x, y) of the face where a ray enters a box that it meets."""
    first, second, _ = box_faces(c, d, half)
    front = first > second
    return torch.where(front, -d[0].sign(), 0.0), torch.where(front, 0.0, -d[1].sign())


def disc_entry(
    c: tuple[Tensor, Tensor], d: tuple[Tensor, Tensor], radius: float | Tensor, within: Tensor
) -> Tensor:
    """``t`` at which a ray enters a disc of ``radius`` (m), if it passes ``within`` of ``c``."""
    square = d[0] * d[0] + d[1] * d[1]
    along = c[0] * d[0] + c[1] * d[1]
    across = (c[1] * d[0] - c[0] * d[1]).square()
    room = square * (radius * radius) - across
    enter = (along - room.clamp_min(1e-12).sqrt()) / square
    return torch.where((across <= square * within * within) & (enter > 0), enter, math.inf)


def drum_reach(turn: Tensor, radius: float) -> Tensor:
    r"""How far from the middle of a drum a ray of direction ``turn`` (rad) may pass to hit it.

    The silhouette ends at a corner: :math:`r \cos(\delta)`, with :math:`\\delta` the angle
    between the normal of the ray and the next corner. A quarter turn is six sides, so that
    the ray itself tells.
    """
    side = math.tau / SIDES
    delta = turn - side * (turn / side).round()
    square = delta * delta  # at most (pi/24)^2: the next term of the cosine is below 1e-8
    return radius * (1 - square / 2 + square * square / 24)


def drum_entry(c: tuple[Tensor, Tensor], d: tuple[Tensor, Tensor], radius: float) -> Tensor:
    """``t`` at which a ray that meets a drum enters it: the last of the sides that face it."""
    number = torch.arange(SIDES, device=d[0].device, dtype=d[0].dtype).unsqueeze(-1)
    angle = (number + 0.5) * (math.tau / SIDES)
    x, y = angle.cos(), angle.sin()
    toward = x * d[0].unsqueeze(-2) + y * d[1].unsqueeze(-2)
    beyond = x * c[0].unsqueeze(-2) + y * c[1].unsqueeze(-2) + radius * math.cos(math.pi / SIDES)
    return torch.where(toward < 0, beyond / toward, -math.inf).amax(-2)

"""What stands around the robot and how it is lit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dntorch.colors import check_missing
from dntorch.quantities import Interval, check_quantities, check_vector

if TYPE_CHECKING:
    import numpy as np  # not needed to see the ring in torch

SHAPES = ("box", "cylinder", "sphere")
SHARE, BLOCKS = Interval(0, 1), Interval(1, 1000, whole=True)


@dataclass(frozen=True)
class Light:
    """One lamp far away. The defaults are white and keep painted hues within one degree.

    Raises:
        ValueError: a direction of length 0, or a colour or coefficient outside 0 to 1.
    """

    direction: tuple[float, float, float] = (0.5, 0.3, 1.0)
    """from the floor to the lamp; z is up"""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """red, green, blue, each 0 to 1"""
    ambient: float = 0.6
    diffuse: float = 0.35
    specular: float = 0.0
    shadow: bool = False
    """drawing shadows takes about three times as long"""

    def __post_init__(self) -> None:
        check_vector("direction", self.direction, Interval(-1e6, 1e6))
        if not any(self.direction):
            raise ValueError(
                f"direction={self.direction!r} points nowhere: give a vector (x, y, z)"
            )
        check_vector("color", self.color, SHARE)
        for name in ("ambient", "diffuse", "specular"):
            SHARE.check(name, getattr(self, name))


@dataclass(frozen=True)
class Ring:
    """Blocks spread evenly on a circle around the robot.

    Block ``k`` stands at ``(k + 1/2)`` parts of the circle, so that a robot that starts
    with yaw 0 looks between two blocks and has found nothing by standing still.

    Raises:
        ValueError: unknown shape, sizes not positive, blocks that do not fit, ``missing`` colours
            that are no different letters.
    """

    blocks: int = 16
    radius: float = 0.40
    """m, from the robot to the middle of a block"""
    block_size: float = 0.08
    """m, width and height"""
    block_shape: str = "box"
    """``box``, ``cylinder``, ``sphere``, or ``mixed``: the three in turn"""
    missing: str = ""
    """letters of colours of which no block stands there. Each place is filled: blocks of the
    other colours, in turn, stand in for theirs, and all else is as it would be without"""

    def __post_init__(self) -> None:
        check_quantities(blocks=self.blocks, radius=self.radius, block_size=self.block_size)
        BLOCKS.check("blocks", self.blocks)
        if not isinstance(self.block_shape, str) or self.block_shape not in (*SHAPES, "mixed"):
            raise ValueError(
                f"block_shape={self.block_shape!r} is unknown: choose from {(*SHAPES, 'mixed')}"
            )
        check_missing(self.missing)
        # Boxes turn a face to the robot, so the inner faces are where they meet first.
        inner = self.radius - self.block_size / 2
        if inner < 0.1 or (
            self.blocks > 1 and 2 * inner * math.tan(math.pi / self.blocks) < self.block_size
        ):
            raise ValueError(
                f"blocks={self.blocks} of block_size={self.block_size} do not fit at "
                f"radius={self.radius}: give fewer or smaller blocks or a larger radius"
            )

    @property
    def angles(self) -> np.ndarray:
        """rad, direction of every block seen from the middle."""
        import numpy as np

        return (np.arange(self.blocks) + 0.5) * (2 * math.pi / self.blocks)

    @property
    def centers(self) -> np.ndarray:
        """m, ``(blocks, 2)``."""
        import numpy as np

        return self.radius * np.stack((np.cos(self.angles), np.sin(self.angles)), axis=1)

    def draw(self, colors: str, random: np.random.Generator) -> np.ndarray:
        """The position in ``colors`` of each block's colour, drawn, each colour as often.

        Then those that are ``missing`` are replaced, `without` another draw.
        """
        import numpy as np

        each = np.repeat(np.arange(len(colors)), self.blocks // len(colors))
        return without(random.permutation(each), self.missing, colors)


def without(layout: np.ndarray, missing: str, colors: str) -> np.ndarray:
    """A layout in which blocks of ``missing`` colours became those of the others, in turn.

    >>> import numpy as np
    >>> without(np.array([2, 0, 2, 3, 1, 2, 2]), "B", "RGBY").tolist()
    [0, 0, 1, 3, 1, 3, 0]
    """
    import numpy as np

    gone = np.isin(layout, [colors.index(letter) for letter in missing])
    layout, left = layout.copy(), np.unique(layout[~gone])
    layout[gone] = np.resize(left, gone.sum())
    return layout


#: White light from above, without shadows.
DAYLIGHT = Light()

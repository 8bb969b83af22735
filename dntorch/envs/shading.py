r"""How bright a painted surface is: the light of TinyRenderer, PyBullet's software renderer.

Under a lamp in direction :math:`l` a surface with paint :math:`p` (0 to 255) and normal
:math:`n` has the colour

.. math:: \lfloor p (a + l_c (k_d \max(0, n \cdot l) + k_s \max(0, r_z)^2)) \rfloor

with the lamp's colour :math:`l_c`, its coefficients :math:`a, k_d, k_s` (ambient, diffuse,
specular) and the reflection :math:`r = 2 (n \cdot l) n - l`, of which :math:`z` counts.
"""

import colorsys
import math
from collections.abc import Callable

from torch import Tensor

from dntorch.colors import HUES
from dntorch.envs.layout import Light

#: Paint of the floor, 0 to 1.
GRAY = 0.5


class Shading:
    """One lamp, the paints of upright walls, and a gray floor.

    Args:
        light: the lamp.
        colors: letters of the paints.
        tensor: makes a tensor of floats.
    """

    def __init__(self, light: Light, colors: str, tensor: Callable[[list], Tensor]) -> None:
        self.light, self.color = light, tensor(list(light.color))
        paints = [colorsys.hsv_to_rgb(HUES[letter] / 360, 1, 1) for letter in colors]
        self.paints = tensor([[float(int(255 * part)) for part in paint] for paint in paints])
        self.lamp = tensor(list(light.direction)) / math.hypot(*light.direction)
        height = self.lamp[2]
        # A wall mirrors the lamp upwards only if the lamp is below it; the floor if it is above.
        self.gloss = self.color * light.specular * (-height).clamp_min(0).square()
        above = (height > 0) * (light.diffuse * height + light.specular * height.square())
        gray = tensor([float(int(255 * GRAY))] * 3)
        self.floor = (gray * (light.ambient + self.color * above)).floor()

    def walls(self, paint: Tensor, diffuse: Tensor) -> Tensor:
        """Colours, whole numbers to 255, ``(*shape, 3)``, of upright walls.

        ``paint`` is a position in the colours and ``diffuse`` the cosine between normal and
        lamp, 0 or more; both ``(*shape,)``.
        """
        lit = self.light.diffuse * diffuse.unsqueeze(-1) * self.color
        bright = self.paints[paint] * (lit + self.gloss + self.light.ambient)
        return bright.floor().clamp_max(255)

r"""From a field over heading directions to the speeds of two wheels.

.. math:: \dot\phi = \frac{\lambda \sum_x f(u_x) \psi_x + \kappa\, \omega_{scan}}
                          {\kappa + \sum_x f(u_x)}
"""

import math

import torch
from torch import Tensor


def bearings(columns: int, fov: float) -> Tensor:
    r"""Direction of each image column, radians, left is positive, ``(columns,)``, float64.

    .. math:: \psi_x = -\arctan\left(\frac{x + 1/2 - n/2}{f}\right), \qquad
              f = \frac{n/2}{\tan(\text{fov}/2)}
    """
    focal = columns / 2 / math.tan(fov / 2)
    return -torch.atan((torch.arange(columns, dtype=torch.float64) + 0.5 - columns / 2) / focal)


def turning_rate(
    output: Tensor, bearing: Tensor, gain: float, scan: float, softness: float
) -> Tensor:
    """Turning rate in rad/s towards the peak of a heading field; ``scan`` where there is none.

    ``output`` is the firing rate of the field, ``(*batch, columns)``.
    """
    attraction = gain * (output * bearing).sum(-1) + softness * scan
    return attraction / (softness + output.sum(-1))


def wheel_speeds(turning: Tensor, wheel_radius: float, axle: float) -> Tensor:
    """Speeds in rad/s, left first, that turn a two-wheeled robot on the spot, ``(*batch, 2)``."""
    right = turning * (axle / 2 / wheel_radius)
    return torch.stack((-right, right), -1)

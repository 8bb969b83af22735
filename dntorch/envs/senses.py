"""What the e-puck senses: the names, and its eight infra-red sensors.

Numbers follow ``E-puck.proto`` and ``E-puckDistanceSensor.proto`` of Webots (Cyberbotics).
"""

import math
from collections.abc import Sequence

from torch import Tensor

SENSES = ("image", "wheels", "proximity")
"""Names in an observation, unless others are asked for."""
KNOWN = (*SENSES, "lamp")
"""All that can be asked for. The lamp is part of no robot: it shows how far the task is."""

#: ps0 ... ps7, clockwise from the front right: x, y, z in metres and direction in radians
#: from straight ahead.
PROXIMITY_SENSORS = (
    (0.030, -0.010, 0.033, 1.27 - math.pi / 2),
    (0.022, -0.025, 0.033, 0.77 - math.pi / 2),
    (0.000, -0.031, 0.033, 0.00 - math.pi / 2),
    (-0.030, -0.015, 0.033, 5.21 - math.pi / 2),
    (-0.030, 0.015, 0.033, 4.21 - math.pi / 2),
    (0.000, 0.031, 0.033, math.pi / 2),
    (0.022, 0.025, 0.033, 2.37 - math.pi / 2),
    (0.030, 0.010, 0.033, 1.87 - math.pi / 2),
)

#: What a sensor reads at a distance: metres, reading without noise.
PROXIMITY_TABLE = (
    (0.000, 4095.00),
    (0.005, 2133.33),
    (0.010, 1465.73),
    (0.015, 601.46),
    (0.020, 383.84),
    (0.030, 234.93),
    (0.040, 158.03),
    (0.050, 120.00),
    (0.060, 104.09),
    (0.070, 67.19),
)

#: Reach of a proximity sensor in metres; beyond it the reading is that at its end.
PROXIMITY_RANGE = PROXIMITY_TABLE[-1][0]


def proximity_reading(distance: Tensor, table: Tensor) -> Tensor:
    """Readings for ``distance`` in metres, 0 and more: ``table``, straight between its rows.

    ``table`` is `PROXIMITY_TABLE` as a tensor.
    """
    meters, reading = table.unbind(-1)
    part = (distance.unsqueeze(-1) - meters[:-1]) / meters.diff()
    return reading[0] + (part.clamp(0, 1) * reading.diff()).sum(-1)


def check_senses(senses: Sequence[str], known: tuple[str, ...] = KNOWN) -> None:
    """Raise a ``ValueError`` for a name that is not ``known``: by default, amid blocks."""
    if not isinstance(senses, Sequence):
        raise ValueError(f"senses={senses!r}: give a tuple out of {known}")
    for name in senses:
        if name not in known:
            raise ValueError(f"senses={senses!r}: {name!r} is unknown, give a tuple out of {known}")

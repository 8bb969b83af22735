"""Sentences about plain numbers with a unit; `dntorch.checks` has those about tensors."""

import math


def check_quantities(**quantities: float) -> None:
    """Raise a ``ValueError`` that names the first quantity that is not positive and finite.

    >>> check_quantities(axle=0.052, dt=1 / 32)
    """
    for name, value in quantities.items():
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"{name}={value!r} is not positive and finite: give a number above 0")


def per_second(dt: float) -> float:
    """How many steps of ``dt`` seconds are in a second, as a whole number where it is one.

    >>> per_second(1 / 32), per_second(0.1), per_second(0.15)
    (32, 10, 6.666666666666667)
    """
    rate = 1 / dt
    return round(rate) if math.isclose(rate, round(rate), rel_tol=1e-9) else rate

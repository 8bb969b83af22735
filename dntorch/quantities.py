"""Sentences about plain numbers with a unit; `dntorch.checks` has those about tensors."""

import math


def check_quantities(**quantities: float) -> None:
    """Raise a ``ValueError`` that names the first quantity that is not positive and finite.

    >>> check_quantities(axle=0.052, dt=1 / 32)
    """
    for name, value in quantities.items():
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"{name}={value!r} is not positive and finite: give a number above 0")

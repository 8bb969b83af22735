r"""Conditions of dissatisfaction: intentions that have waited too long.

.. math::
    \dot x_i &= \frac{I_i}{T} - \frac{(1 - I_i)\, x_i}{\tau_x} \\
    \tau \dot u_i &= -u_i + h + c_{in} f_H(x_i - 1)
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import heaviside
from dntorch.number import Number, either, plus


class DissatisfactionState(NamedTuple):
    waited: Tensor
    """How long each intention has been on, as a share of the patience, ``(*batch, n)``."""
    u: Tensor
    """Activation of the nodes, ``(*batch, n)``."""


@either
def dissatisfaction_step(
    intention: Tensor,
    state: DissatisfactionState,
    patience: Number,
    release: Number,
    tau: Number,
    h: Number,
    gain: Number,
    dt: float,
) -> DissatisfactionState:
    """One Euler step of ``dt`` seconds."""
    waited = state.waited
    rate = intention / patience - (1 - intention) * waited / release
    target = plus(h + 0 * waited, gain, heaviside(waited, 1.0))
    return DissatisfactionState(
        (waited + dt * rate).clamp(0.0, 2.0), state.u.lerp(target, dt / tau)
    )

r"""Transient pulse cells: a pulse when the input comes on, its negative when it goes off.

.. math:: \tau \dot{TP}^+ &= -TP^+ + I - TP^- \\
          \tau \dot{TP}^- &= -TP^- + I
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.number import Number, either


class TransientState(NamedTuple):
    pulse: Tensor
    """Excitatory cell TP+, the output, any shape."""
    inhibitory: Tensor
    """Inhibitory cell TP-, which follows the input."""


@either
def transient_rate(input: Tensor, state: TransientState, tau: Number) -> TransientState:
    """Right-hand side, per second."""
    return TransientState(
        (input - state.pulse - state.inhibitory) / tau,
        (input - state.inhibitory) / tau,
    )


@either
def transient_step(input: Tensor, state: TransientState, tau: Number, dt: float) -> TransientState:
    """One Euler step of ``dt`` seconds."""
    return TransientState(
        state.pulse.lerp(input - state.inhibitory, dt / tau),
        state.inhibitory.lerp(input, dt / tau),
    )

r"""Value opposition: discounted value of the new pair against the value of the old one.

.. math::
    \tau_O \dot O_{ij} &= -O_{ij} + f_H(u_{ij} - \theta_u) W_{ij}
        \big(\gamma f_H(TP^+_{ij} - \theta) - f_H(-TP^+_{ij} - \theta)\big) \\
    \tau_v \dot v &= -v + \sum_{ij} O_{ij}
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.number import Number, either


class OppositionState(NamedTuple):
    opposition: Tensor
    """Value opposition field O, ``(*batch, n, n)``."""
    error: Tensor
    """Value cell v, the temporal-difference error without reward, ``(*batch,)``."""


@either
def opposed_values(
    pulse: Tensor,
    trace: Tensor,
    weights: Tensor,
    discount: Number,
    pulse_threshold: Number,
    trace_threshold: Number,
) -> Tensor:
    """Discounted value of the pair that came on, less the value of the one that went off."""
    remembered = weights * (trace > trace_threshold)
    onset, offset = pulse > pulse_threshold, pulse < -pulse_threshold
    return discount * remembered * onset - remembered * offset


@either
def opposition_rate(
    pulse: Tensor,
    trace: Tensor,
    weights: Tensor,
    state: OppositionState,
    discount: Number,
    tau: Number,
    tau_error: Number,
    pulse_threshold: Number,
    trace_threshold: Number,
) -> OppositionState:
    """Right-hand side, per second."""
    input = opposed_values(pulse, trace, weights, discount, pulse_threshold, trace_threshold)
    return OppositionState(
        (input - state.opposition) / tau,
        (state.opposition.sum((-2, -1)) - state.error) / tau_error,
    )


@either
def opposition_step(
    pulse: Tensor,
    trace: Tensor,
    weights: Tensor,
    state: OppositionState,
    discount: Number,
    tau: Number,
    tau_error: Number,
    pulse_threshold: Number,
    trace_threshold: Number,
    dt: float,
) -> OppositionState:
    """One Euler step of ``dt`` seconds."""
    input = opposed_values(pulse, trace, weights, discount, pulse_threshold, trace_threshold)
    return OppositionState(
        state.opposition.lerp(input, dt / tau),
        state.error.lerp(state.opposition.sum((-2, -1)), dt / tau_error),
    )

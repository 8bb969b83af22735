r"""Nodes that keep which behaviours were completed before the last one.

.. math::
    \tau \dot u_{ki} &= -u_{ki} + h + c_+ f(u_{ki}) - c_- \sum_{l \neq i} f(u_{kl})
        + c_p f_H(-TP^+_{k-1,i} - \theta) \\
    \tau_p \dot{TP}^+_{ki} &= -TP^+_{ki} + f(u_{ki}) - TP^-_{ki}, \qquad
    \tau_p \dot{TP}^-_{ki} = -TP^-_{ki} + f(u_{ki})

Level 0, :math:`f(u_{0i})`, is the CoS nodes.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import heaviside
from dntorch.cells.node import node_target
from dntorch.cells.transient import TransientState, transient_step
from dntorch.number import Number, either


class RecallState(NamedTuple):
    u: Tensor
    """Activation of the nodes, level by level, ``(*batch, depth, n)``."""
    pulse: Tensor
    """Excitatory transient pulse cells of the level below."""
    inhibitory: Tensor
    """Inhibitory ones."""


@either
def recall_step(
    satisfaction: Tensor,
    output: Tensor,
    state: RecallState,
    tau: Number,
    tau_pulse: Number,
    h: Number,
    excitation: Number,
    inhibition: Number,
    pulse_gain: Number,
    pulse_threshold: float,
    dt: float,
) -> RecallState:
    """One Euler step of ``dt`` seconds; ``output`` is f(u)."""
    below = torch.cat((satisfaction.unsqueeze(-2), output), -2)[..., :-1, :]
    drive = pulse_gain * heaviside(-state.pulse, pulse_threshold)
    target = node_target(drive, output, h, excitation, inhibition)
    pulses = transient_step(below, TransientState(state.pulse, state.inhibitory), tau_pulse, dt)
    return RecallState(state.u.lerp(target, dt / tau), pulses.pulse, pulses.inhibitory)


def conjunctions(satisfaction: Tensor, recalled: Tensor) -> Tensor:
    """Rates of the last completions in their order, ``(*batch, n ** (1 + levels))``.

    The product of one rate of each level, last completion first: with ``recalled``
    ``(*batch, 2, n)`` that of i, then j, then k stands at ``i * n * n + j * n + k``.
    """
    product = satisfaction
    for level in recalled.unbind(-2):
        product = (product.unsqueeze(-1) * level.unsqueeze(-2)).flatten(-2)
    return product

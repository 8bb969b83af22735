r"""Neural nodes with self-excitation that compete: winner takes all.

.. math:: \tau \dot u_i = -u_i + h + c_+ f(u_i) - c_- \sum_{k \neq i} f(u_k) + S_i
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import abs_sigmoid
from dntorch.number import Number, either


class NodeState(NamedTuple):
    u: Tensor
    """Activation, ``(*batch, n)``."""


@either
def node_rate(
    input: Tensor,
    state: NodeState,
    tau: Number,
    h: Number,
    excitation: Number,
    inhibition: Number,
    steepness: float,
    threshold: float,
) -> NodeState:
    """Right-hand side, per second."""
    output = abs_sigmoid(state.u, steepness, threshold)
    others = output.sum(-1, keepdim=True) - output
    return NodeState((-state.u + h + excitation * output - inhibition * others + input) / tau)


@either
def node_step(
    input: Tensor,
    state: NodeState,
    tau: Number,
    h: Number,
    excitation: Number,
    inhibition: Number,
    steepness: float,
    threshold: float,
    dt: float,
) -> NodeState:
    """One Euler step of ``dt`` seconds."""
    rate = node_rate(input, state, tau, h, excitation, inhibition, steepness, threshold)
    return NodeState(state.u + dt * rate.u)

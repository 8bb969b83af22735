r"""Neural nodes with self-excitation that compete: winner takes all.

.. math:: \tau \dot u_i = -u_i + h + c_+ f(u_i) - c_- \sum_{k \neq i} f(u_k) + S_i

A step ends at the ``floor``, if there is one: no activation falls below it.
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import abs_sigmoid
from dntorch.number import Number, either, plus


class NodeState(NamedTuple):
    u: Tensor
    """Activation, ``(*batch, n)``."""


@either
def node_target(
    input: Tensor, output: Tensor, h: Number, excitation: Number, inhibition: Number
) -> Tensor:
    """Where the leak pulls ``u``: all of the right-hand side but ``-u``; ``output`` is f(u)."""
    others = output.sum(-1, keepdim=True) - output
    return plus(plus(input + h, excitation, output), -inhibition, others)


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
    return NodeState((node_target(input, output, h, excitation, inhibition) - state.u) / tau)


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
    floor: float | None = None,
) -> NodeState:
    """One Euler step of ``dt`` seconds."""
    output = abs_sigmoid(state.u, steepness, threshold)
    target = node_target(input, output, h, excitation, inhibition)
    return NodeState(floored(state.u.lerp(target, dt / tau), floor))


def floored(u: Tensor, floor: float | None) -> Tensor:
    """``u``, and nothing below the floor."""
    return u if floor is None else u.clamp_min(floor)

r"""Hebbian learning of action values, gated by reward and temporal-difference error.

.. math:: \dot W_{ij} = \eta\, (1 - I_{ij}) (r + v)\, u_{ij}
"""

from typing import NamedTuple

from torch import Tensor


class HebbianState(NamedTuple):
    weights: Tensor
    """Action values Q, ``[action, state]``, ``(*batch, n, n)``: long-term memory."""


def hebbian_rate(
    active: Tensor, trace: Tensor, error: Tensor, reward: Tensor, learning_rate: Tensor
) -> HebbianState:
    """Right-hand side, per second. It does not depend on the weights themselves."""
    signal = (learning_rate * (reward + error)).unsqueeze(-1).unsqueeze(-1)
    return HebbianState((trace - active * trace) * signal)


def hebbian_step(
    active: Tensor,
    trace: Tensor,
    error: Tensor,
    reward: Tensor,
    state: HebbianState,
    learning_rate: Tensor,
    dt: float,
) -> HebbianState:
    """One Euler step of ``dt`` seconds."""
    rate = hebbian_rate(active, trace, error, reward, learning_rate)
    return HebbianState(state.weights.add(rate.weights, alpha=dt))

r"""Value nodes: read the learned values of the current state, relative to the best action.

.. math:: \tau \dot d_i = -d_i + \Big(\frac{x_i}{\max_k x_k}\Big)^p, \qquad
          x_i = \Big(\Big[\sum_j W_{ij} s_j + \xi_i\Big]_+ + b_i\Big) a_i, \qquad
          s_j = f_H(c_j - 1/2)
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import is_on
from dntorch.number import Number, either


class ValueState(NamedTuple):
    value: Tensor
    """Activation of the value nodes, ``(*batch, n)``."""


@either
def normalized_values(
    context: Tensor,
    weights: Tensor,
    noise: Tensor,
    available: Tensor,
    baseline: Tensor,
    sharpness: Number,
) -> Tensor:
    """Value of each action in the current state, 1 for the best, ``(*batch, n)``.

    ``weights`` is ``[action, state]``; ``context`` the firing rate of each state. Rates below
    1/2 are ignored; small ones of resting nodes would sum to a spurious state. ``available``, 0 to
    1, is what is left of each action: 0 for one that may not be taken.
    """
    learned = (weights * is_on(context).unsqueeze(-2)).sum(-1)
    worth = ((learned + noise).clamp_min(0.0) + baseline) * available
    return (worth / worth.amax(-1, keepdim=True).clamp_min(1e-9)) ** sharpness


@either
def value_rate(
    context: Tensor,
    weights: Tensor,
    noise: Tensor,
    available: Tensor,
    state: ValueState,
    baseline: Tensor,
    sharpness: Number,
    tau: Number,
) -> ValueState:
    """Right-hand side, per second."""
    values = normalized_values(context, weights, noise, available, baseline, sharpness)
    return ValueState((values - state.value) / tau)


@either
def value_step(
    context: Tensor,
    weights: Tensor,
    noise: Tensor,
    available: Tensor,
    state: ValueState,
    baseline: Tensor,
    sharpness: Number,
    tau: Number,
    dt: float,
) -> ValueState:
    """One Euler step of ``dt`` seconds."""
    values = normalized_values(context, weights, noise, available, baseline, sharpness)
    return ValueState(state.value.lerp(values, dt / tau))

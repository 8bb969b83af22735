r"""Value nodes: read the learned values of the current state, normalised over actions.

.. math:: \tau \dot d_i = -d_i + \frac{x_i}{\sum_k x_k}, \qquad
          x_i = \Big[\sum_{j \neq i} (W_{ij} + \xi_{ij}) s_j\Big]_+ + b_i (1 - s_i), \qquad
          s_j = f_H(f_S(d_j^{cos}) - 1/2)
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import is_on
from dntorch.number import Number, either


class ValueState(NamedTuple):
    value: Tensor
    """Activation of the value nodes, ``(*batch, n)``."""


def normalized_values(satisfaction: Tensor, weights: Tensor, baseline: Tensor) -> Tensor:
    """Share of each action in the values of the current state, ``(*batch, n)``, sum one.

    ``weights`` is ``[action, state]``; ``satisfaction`` the output of the CoS nodes. Outputs
    below 1/2 are ignored; small outputs of resting nodes would sum to a spurious state.
    """
    state = is_on(satisfaction)
    learned = (weights * state.unsqueeze(-2)).sum(-1).clamp_min(0.0)
    total = (learned + baseline * ~state).clamp_min(1e-9)  # a sum of 0 has no shares
    return total / total.sum(-1, keepdim=True)


@either
def value_rate(
    satisfaction: Tensor, weights: Tensor, state: ValueState, baseline: Tensor, tau: Number
) -> ValueState:
    """Right-hand side, per second."""
    return ValueState((normalized_values(satisfaction, weights, baseline) - state.value) / tau)


@either
def value_step(
    satisfaction: Tensor,
    weights: Tensor,
    state: ValueState,
    baseline: Tensor,
    tau: Number,
    dt: float,
) -> ValueState:
    """One Euler step of ``dt`` seconds."""
    shares = normalized_values(satisfaction, weights, baseline)
    return ValueState(state.value.lerp(shares, dt / tau))

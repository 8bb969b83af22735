r"""Suppression weights: which behaviour fails in which state.

.. math:: \dot S_{ij} = \eta \big((1 - S_{ij})\, d_i s_j - S_{ij}\, o_{ij} c_i\big)
          - \frac{S_{ij}}{\tau_f}
"""

from torch import Tensor

from dntorch.cells.functions import rectified
from dntorch.number import Number, either


@either
def constraint_step(
    failing: Tensor,
    context: Tensor,
    offset: Tensor,
    satisfaction: Tensor,
    weights: Tensor,
    learning_rate: Number,
    fade: Number,
    dt: float,
) -> Tensor:
    """One Euler step of ``dt`` seconds; ``weights`` is ``[action, state]``, within 0 and 1."""
    failed = failing.unsqueeze(-1) * rectified(context, 0.5).unsqueeze(-2)
    succeeded = offset * satisfaction.unsqueeze(-1)
    learned = learning_rate * ((1 - weights) * failed - weights * succeeded)
    return weights + dt * (learned - weights / fade)

r"""State-action cells: which behaviour runs after which was completed.

.. math:: I_{ij} = f_H\big(f_S(d_i^{int})\, f_S(d_j^{cos}) - \theta\big), \quad i \neq j
"""

from torch import Tensor

from dntorch.number import Number, either


@either
def coincidence(
    intention: Tensor, satisfaction: Tensor, off_diagonal: Tensor, threshold: Number
) -> Tensor:
    """Pairs ``[action, state]`` that are active, zeros and ones, ``(*batch, n, n)``.

    At steady state, without dynamics of their own. ``intention`` and ``satisfaction`` are
    outputs (between 0 and 1) of the intention and CoS nodes, ``(*batch, n)``.
    """
    product = intention.unsqueeze(-1) * satisfaction.unsqueeze(-2)
    return (product > threshold) * off_diagonal

r"""State-action cells: which behaviour runs after which was completed.

.. math:: I_{ij} = f_H\big(f_S(d_i^{int})\, f_S(d_j^{cos}) - \theta\big), \quad i \neq j
"""

from torch import Tensor

from dntorch.number import Number, either


@either
def coincidence(
    intention: Tensor, context: Tensor, off_diagonal: Tensor, threshold: Number
) -> Tensor:
    """Pairs ``[action, state]`` that are active, zeros and ones, ``(*batch, n, states)``.

    At steady state, without dynamics of their own. ``intention`` ``(*batch, n)`` and ``context``
    ``(*batch, states)`` are firing rates (between 0 and 1): in the paper those of the intention
    and of the CoS nodes. ``off_diagonal`` is 0 where action and state are one behaviour.
    """
    product = intention.unsqueeze(-1) * context.unsqueeze(-2)
    return (product > threshold) * off_diagonal

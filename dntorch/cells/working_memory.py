r"""Item-and-order working memory: a recurrent on-center off-surround shunting network.

.. math:: \tau \dot u_m = (1-u_m)(\alpha q_m + \beta u_m)
                        - u_m\Big(\alpha \sum_{k \neq m} q_k + \beta \sum_{k \neq m} u_k\Big)

which is the same as :math:`\alpha q_m + \beta u_m - u_m (\alpha Q + \beta U)` with the sums
Q and U over all cells: the form computed here, without a sum per cell.
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import rectified


class WorkingMemoryState(NamedTuple):
    u: Tensor
    """Activity between 0 and 1, ``(*batch, n, n)``."""


def working_memory_rate(
    pulse: Tensor,
    state: WorkingMemoryState,
    tau: float,
    excitation: float,
    feedback: float,
    threshold: float,
) -> WorkingMemoryState:
    """Right-hand side, per second. The last two dimensions are one field of cells."""
    u = state.u
    drive = excitation * rectified(pulse, threshold) + feedback * u
    total = drive.sum((-2, -1), keepdim=True)
    return WorkingMemoryState((drive - u * total) / tau)


def working_memory_step(
    pulse: Tensor,
    state: WorkingMemoryState,
    tau: float,
    excitation: float,
    feedback: float,
    threshold: float,
    dt: float,
) -> WorkingMemoryState:
    """One Euler step of ``dt`` seconds."""
    rate = working_memory_rate(pulse, state, tau, excitation, feedback, threshold)
    return WorkingMemoryState(state.u + dt * rate.u)

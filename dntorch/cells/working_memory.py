r"""Item-and-order working memory: a recurrent on-center off-surround shunting network.

.. math:: \tau \dot u_m = (1-u_m)(\alpha q_m + \beta u_m)
                        - u_m\Big(\alpha \sum_{k \neq m} q_k + \beta \sum_{k \neq m} u_k\Big)

which is the same as :math:`d_m - u_m D` with the drive :math:`d_m = \alpha q_m + \beta u_m` and
its sum D over all cells: the form computed here, without a sum per cell.
"""

from typing import NamedTuple

from torch import Tensor

from dntorch.cells.functions import rectified
from dntorch.number import Number, either, plus


class WorkingMemoryState(NamedTuple):
    u: Tensor
    """Activity between 0 and 1, ``(*batch, n, n)``."""


@either
def working_memory_rate(
    pulse: Tensor,
    state: WorkingMemoryState,
    tau: Number,
    excitation: Number,
    feedback: Number,
    threshold: float,
) -> WorkingMemoryState:
    """Right-hand side, per second. The last two dimensions are one field of cells."""
    drive = plus(excitation * rectified(pulse, threshold), feedback, state.u)
    total = drive.sum((-2, -1), keepdim=True)
    return WorkingMemoryState((drive - state.u * total) / tau)


@either
def working_memory_step(
    pulse: Tensor,
    state: WorkingMemoryState,
    tau: Number,
    excitation: Number,
    feedback: Number,
    threshold: float,
    dt: float,
) -> WorkingMemoryState:
    r"""One Euler step of ``dt`` seconds, shortened where strong pulses would make it overshoot.

    A step of :math:`\Delta / \tau`, or of :math:`1 / D` where that is less, goes at most to the
    goal :math:`d_m / D`, which lies between 0 and 1, as u does.
    """
    pulse = pulse.clamp_max(tau / (dt * excitation))  # alone it fills the memory in one step
    drive = plus(excitation * rectified(pulse, threshold), feedback, state.u)
    total = drive.sum((-2, -1), keepdim=True)
    return WorkingMemoryState(state.u + (drive - state.u * total) / total.clamp_min(tau / dt))

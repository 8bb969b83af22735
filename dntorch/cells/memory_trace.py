r"""Memory trace of a field: it builds up where the field is on, and decays elsewhere.

.. math:: \dot m(x) = \begin{cases} (S(x) - m(x)) / \tau_+ & S(x) > \theta \\
                                     -m(x) / \tau_-          & \text{else} \end{cases}
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.number import Number, either


class MemoryTraceState(NamedTuple):
    trace: Tensor
    """Strength of the trace, ``(*batch, *shape)``."""


@either
def share(tau: Number, dt: float) -> Number:
    """How much of the way to its goal a decay goes in ``dt`` seconds, exactly."""
    if isinstance(tau, float):
        return -math.expm1(-dt / tau)
    return -torch.expm1(-dt / tau)


@either
def memory_trace_step(
    input: Tensor, state: MemoryTraceState, build: Number, decay: Number, threshold: float
) -> MemoryTraceState:
    """One exact step for an input that is held; ``build`` and ``decay`` are its `share` s."""
    trace = state.trace
    grown, faded = trace + build * (input - trace), trace - decay * trace
    return MemoryTraceState(torch.where(input > threshold, grown, faded))

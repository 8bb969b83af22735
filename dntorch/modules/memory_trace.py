"""Memory traces: where a field was active before."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.kernels import sites
from dntorch.cells.memory_trace import MemoryTraceState, memory_trace_step, share
from dntorch.checks import check_dtype, check_ends, check_floats, check_positive, shown
from dntorch.dynamics import Dynamics
from dntorch.memory import extended
from dntorch.number import Number, wide


class MemoryTrace(Dynamics[MemoryTraceState]):
    r"""Memory trace (preshape) of a field: builds up where the field is on, decays elsewhere.

    .. math:: \dot m(x) = \begin{cases} (S(x) - m(x)) / \tau_+ & S(x) > \theta \\
                                         -m(x) / \tau_-          & \text{else} \end{cases}

    ================  ==============  ====  ==================================================
    symbol            here            unit  meaning
    ================  ==============  ====  ==================================================
    :math:`m`         ``trace``       1     strength of the trace
    :math:`S`         ``input``       1     output of the field
    :math:`\tau_+`    ``tau_build``   s     time constant with which it builds up
    :math:`\tau_-`    ``tau_decay``   s     time constant with which it decays
    :math:`\theta`    ``threshold``   1     of the input
    \                 ``frozen``      --    whether nothing changes while no site is above
                                            ``threshold``; else the trace always decays
    ================  ==============  ====  ==================================================

    A step is the exact solution for an input that is held, so that a trace is the same after one
    second at any ``dt``. ``tau_build`` and ``tau_decay`` may be tensors ``(*batch,)``.

    Shapes: input and output ``(*batch, *shape)``; the output is the trace after the step.
    State: ``MemoryTraceState(trace)``.

    The trace is **long-term memory**: a persistent buffer, 0 at first, which ``reset`` and
    ``resize`` never touch. ``spread(*batch)`` gives each member of a batch a trace of its own,
    ``select(k)`` keeps that of one, ``forget()`` erases it.

    Raises:
        ValueError: a time constant not positive; a trace whose batch is not that of the inputs.

    Source: Erlhagen and Schöner, "Dynamic field theory of movement preparation", 2002. COSIVINA's
    element takes an Euler step of fixed length, whatever its time step is. Not in the paper.

    >>> trace = MemoryTrace(3, tau_build=0.5, tau_decay=2.0)
    >>> for _ in range(32):  # one second
    ...     output = trace(torch.tensor([0.0, 1.0, 0.0]))
    >>> output
    tensor([0.0000, 0.8647, 0.0000])
    >>> for _ in range(32):
    ...     output = trace(torch.zeros(3))  # the field is silent: the trace stays
    >>> output
    tensor([0.0000, 0.8647, 0.0000])
    """

    lasting = ("trace",)
    settable = ("frozen",)
    trace: Tensor
    shape: list[int]

    def __init__(
        self,
        shape: int | Sequence[int],
        tau_build: Number = 0.5,
        tau_decay: Number = 5.0,
        threshold: float = 0.5,
        frozen: bool = True,
        dt: float = 1 / 32,
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__(dt)
        check_floats(dtype)
        self.shape, self.tau_build, self.tau_decay = sites(shape), tau_build, tau_decay
        self.threshold, self.frozen = threshold, frozen
        self.register_buffer("trace", torch.zeros(self.shape))
        self.to(dtype=dtype)

    def check(self) -> None:
        if not isinstance(self.frozen, bool):
            raise TypeError(f"frozen={shown(self.frozen)}: give True or False")
        for name in ("tau_build", "tau_decay"):
            check_positive(name, getattr(self, name), "give seconds")

    def initial(self, batch: list[int]) -> MemoryTraceState:
        """What has been learned, for each member of ``batch``."""
        return MemoryTraceState(extended(self.trace, len(self.shape), batch))

    def output(self, state: MemoryTraceState) -> Tensor:
        return state.trace.clone()

    def euler(self, input: Tensor, state: MemoryTraceState) -> MemoryTraceState:
        check_ends("input", input, self.shape)
        check_dtype("input", input, state.trace.dtype)
        axes = len(self.shape)
        build = wide(share(self.tau_build, self.dt), axes)
        decay = wide(share(self.tau_decay, self.dt), axes)
        ahead = memory_trace_step(input, state, build, decay, self.threshold)
        if self.frozen:
            on = input > self.threshold
            for _ in range(axes):
                on = on.any(-1)
            going = on.reshape(list(on.shape) + [1] * axes)
            ahead = MemoryTraceState(torch.where(going, ahead.trace, state.trace))
        return ahead

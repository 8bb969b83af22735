"""The contract of every structure: state in buffers, one pure step in continuous time.

A structure is an ``nn.Module`` whose *activation* lives in buffers and moves by a pure
function of inputs and state::

    output, state = module.step(input, state)     # pure: differentiable, vmap-able, exportable
    output = module(input)                        # get state, step, set state

The fields of the state (a ``NamedTuple``) bear the names of the attributes that hold it:
a buffer in a single structure, a sub-module in a composite.

Activation is forgotten by `reset` and is in no checkpoint; *long-term memory* (learned
values, memory traces) is a persistent buffer that only an explicit call erases.
"""

import torch
from torch import Tensor, nn


class Dynamics(nn.Module):
    """Base of all structures. A subclass provides

    * ``initial(batch)``: the state at rest, for inputs with leading dimensions ``batch``;
    * ``step(..., state)``: one time step, returning ``(output, state)``;
    * ``state``: a property whose getter returns clones and whose setter calls `overwrite`;

    and calls ``resize()`` at the end of ``__init__``. ``forward`` below serves structures
    with one input; others write their own two lines.

    Attributes:
        dt: seconds a step.
        origin: zeros of the batch's shape; carries batch, dtype and device of the activation.
    """

    def __init__(self, dt: float) -> None:
        super().__init__()
        if not dt > 0:
            raise ValueError(f"dt={dt} must be positive: give seconds a step, such as dt=1/32")
        self.dt = dt
        self.register_buffer("origin", torch.zeros(()), persistent=False)

    def forward(self, input: Tensor) -> Tensor:
        output, self.state = self.step(input, self.state)
        return output

    @torch.jit.export
    def reset(self) -> None:
        """Put the activation back to rest, in place. Long-term memory stays."""
        self.state = self.initial(list(self.origin.shape))

    @torch.jit.unused
    def resize(self, *batch: int) -> "Dynamics":
        """Allocate activation at rest for leading dimensions ``batch``; returns the module.

        The only method that changes the shape of a buffer. Long-term memory stays as it is.
        """
        state = self.initial(list(batch))  # may refuse: before anything changes
        self.register_buffer("origin", self.origin.new_zeros(batch), persistent=False)
        named = state if isinstance(state, dict) else state._asdict()
        for name, value in named.items():
            part = getattr(self, name, None)
            if isinstance(part, Dynamics):
                part.resize(*batch)
            else:
                self.register_buffer(name, value, persistent=False)
        return self

    @torch.jit.unused
    def snapshot(self) -> dict[str, Tensor]:
        """Copies of all buffers by name: activation and long-term memory, for an exact resume."""
        return {name: buffer.detach().clone() for name, buffer in self.named_buffers()}

    @torch.jit.unused
    def restore(self, snapshot: dict[str, Tensor]) -> None:
        """Go on from a `snapshot` of a structure that was built alike and has the same batch."""
        buffers = dict(self.named_buffers())
        for name in buffers.keys() | snapshot.keys():
            ours, theirs = buffers.get(name), snapshot.get(name)
            if ours is None or theirs is None or ours.shape != theirs.shape:
                raise ValueError(
                    f"the snapshot is of another architecture: {name} is "
                    f"{'missing' if theirs is None else list(theirs.shape)} there and "
                    f"{'missing' if ours is None else list(ours.shape)} here; build the structure "
                    "with the arguments it was saved with"
                )
        for name, buffer in buffers.items():
            buffer.copy_(snapshot[name])


def overwrite(buffer: Tensor, value: Tensor) -> None:
    """Write a new state into a buffer, in place, cut off from the graph.

    In place, since a rebound buffer is lost by ``torch.jit.trace`` and ``torch.export``.
    """
    if buffer.shape != value.shape:
        raise ValueError(
            f"state of shape {list(value.shape)} does not fit the buffer of shape "
            f"{list(buffer.shape)}: call resize(*batch) with the batch of the inputs first"
        )
    buffer.copy_(value.detach())


def check_parts(whole: Dynamics, n: int, dt: float) -> None:
    """Raise unless all parts of a composite are for ``n`` behaviours and step by ``dt``."""
    for name, part in whole.named_modules():
        if part is whole or not isinstance(part, Dynamics):
            continue
        if abs(part.dt - dt) > 1e-9 * dt:
            raise ValueError(f"{name}.dt={part.dt} does not fit: build the part with dt={dt}")
        if getattr(part, "n", n) != n:
            raise ValueError(f"{name}.n={part.n} does not fit n={n}: build the part with n={n}")


def check_ends(name: str, tensor: Tensor, end: list[int]) -> None:
    """Raise unless the last dimensions of an input are ``end``; it would broadcast in silence."""
    given = list(tensor.shape)
    if given[max(len(given) - len(end), 0) :] != end:
        raise ValueError(
            f"{name} of shape {given} does not end in {end} after its batch: reshape it, or build "
            "the structure with another size"
        )


def check_time_constant(name: str, tau: float, dt: float) -> None:
    """Raise unless an explicit step of ``dt`` can follow a decay with time constant ``tau``."""
    if not tau > 0:
        raise ValueError(f"{name}={tau} must be positive: give seconds")
    if dt > tau:
        raise ValueError(
            f"dt={dt} is longer than {name}={tau}: an explicit step would overshoot; "
            "take a smaller dt, or sub-steps"
        )

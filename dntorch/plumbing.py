"""What the methods call that `dntorch.declare` writes: a state's tensors moved and averaged."""

from torch import Tensor


def halfway(start: Tensor, end: Tensor) -> Tensor:
    """Mean of two states: with ``end`` two Euler steps after ``start``, one step of Heun.

    Counts have no middle: they stay as they were at the start.
    """
    if not start.is_floating_point():
        return start
    return start.lerp(end, 0.5)


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


def remember(memory: Tensor, value: Tensor) -> None:
    """The same for what outlives a reset."""
    if memory.shape != value.shape:
        raise ValueError(
            f"values of shape {list(value.shape)} do not fit the memory of shape "
            f"{list(memory.shape)}: call spread(*batch) to give each its own"
        )
    memory.copy_(value.detach())


def beneath(name: str, flat: dict[str, Tensor]) -> dict[str, Tensor]:
    """The tensors of a part under the names they have in the whole."""
    whole: dict[str, Tensor] = {}
    for own, x in flat.items():
        whole[name + "." + own] = x
    return whole


def within(flat: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with ``prefix``, without it."""
    found: dict[str, Tensor] = {}
    for name, x in flat.items():
        if name.startswith(prefix):
            found[name[len(prefix) :]] = x
    return found


def halfway_each(start: dict[str, Tensor], end: dict[str, Tensor]) -> dict[str, Tensor]:
    """`halfway` between two states by name."""
    middle: dict[str, Tensor] = {}
    for name, x in start.items():
        middle[name] = halfway(x, end[name])
    return middle

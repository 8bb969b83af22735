"""What outlives a reset: long-term memory, and counts over the life of an agent."""

import copy
import math
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from dntorch.checks import check_count
from dntorch.parameters import Parameters, check_batch


class Memory(Parameters):
    """A module whose persistent buffers are long-term memory; see `dntorch.Dynamics`.

    Attributes:
        lasting: names of buffers that outlive ``reset``: long-term memory (persistent) and
            counts over the life of an agent (not persistent).
    """

    lasting: ClassVar[tuple[str, ...]] = ()

    @torch.jit.unused
    def _structures(self) -> "list[Memory]":
        """This structure and all that it is composed of."""
        return [part for part in self.modules() if isinstance(part, Memory)]

    @torch.jit.unused
    def spread(self, *batch: int) -> "Memory":
        """Resize to ``batch``, each member with a copy of the long-term memory, to learn alone."""
        for size in batch:
            check_count("batch", size, 0)
        check_batch(self, list(batch))
        spread = [(part, name, part._spread(name, batch)) for _, part, name in memories(self)]
        for part, name, memory in spread:
            part.register_buffer(name, memory)
        return self.resize(*batch)

    def _spread(self, name: str, batch: tuple[int, ...]) -> Tensor:
        with torch.inference_mode(False):
            return extended(self._buffers[name], self._rank[name], list(batch))

    @torch.jit.unused
    def select(self, index: int) -> "Memory":
        """A new structure without batch, at rest, with what one member of a batch learned.

        Numbers per agent become that agent's, counts go on. Members count from 0 over all
        dimensions of the batch.
        """
        batch = tuple(self.origin.shape)
        if not batch:
            raise ValueError(f"index={index}: there is one set of weights only, nothing to select")
        count = math.prod(batch)
        if not isinstance(index, int) or not -count <= index < count:
            raise ValueError(f"index={index}: give one of 0 to {count - 1}, the batch has {count}")

        def one(tensor: Tensor, rank: int) -> Tensor:
            own = tensor.shape[tensor.dim() - rank :]
            return tensor.expand(*batch, *own).reshape(count, *own)[index].clone()

        with torch.inference_mode(False):
            structure = copy.deepcopy(self)
            for part in structure._structures():
                for name in part.lasting:
                    buffer = part._buffers[name]
                    rank = part._rank.get(name, buffer.dim() - len(batch))
                    kept = one(buffer, rank)
                    part.register_buffer(name, kept, name in part._memory())
                for name, number in part._numbers().items():
                    value = one(number.detach(), 0)
                    learned = isinstance(number, nn.Parameter)
                    part._place(name, nn.Parameter(value) if learned else float(value))
            return structure.resize()

    def _memory(self) -> dict[str, Tensor]:
        """Long-term memory of this structure itself, without its parts."""
        fading = self._non_persistent_buffers_set
        return {name: x for name, x in self._buffers.items() if name not in fading}

    def _note_memory(self) -> None:
        """Check that memory is declared, and keep its rank without a batch."""
        for name in self.lasting:
            if name not in self._buffers:
                raise ValueError(
                    f"{type(self).__name__}.lasting={self.lasting!r} names {name!r}, which is no "
                    "buffer: give a tuple, and register_buffer each in __init__"
                )
        for name in self._memory():
            if name not in self.lasting:
                raise ValueError(
                    f"{name} is a persistent buffer, long-term memory: name it in "
                    f"{type(self).__name__}.lasting, or register it with persistent=False"
                )
        self._rank = {name: buffer.dim() for name, buffer in self._memory().items()}
        _refuse_coarse_memory(self, self.origin.dtype)

    def _own_batch(self) -> torch.Size:
        """The batch in which numbers are given and parts have learned."""
        shapes = [torch.Size()]
        for part in self._structures():
            shapes += [number.shape for number in part._numbers().values()]
            shapes += [x.shape[: x.dim() - part._rank[k]] for k, x in part._memory().items()]
        try:
            return torch.broadcast_shapes(*shapes)
        except RuntimeError:
            several = sorted({tuple(shape) for shape in shapes if shape})
            raise ValueError(
                f"numbers per agent, or what parts learned, are for batches {several}: give all "
                "the same batch"
            ) from None

    def _apply(self, fn: Any, recurse: bool = True) -> "Memory":
        with torch.inference_mode(False):
            _refuse_coarse_memory(self, fn(torch.zeros((), dtype=self.origin.dtype)).dtype)
            return super()._apply(fn, recurse)


def memories(structure: Memory) -> list[tuple[str, Memory, str]]:
    """Long-term memory in all parts: path of the part, the part, name of its buffer."""
    parts = [(path, x) for path, x in structure.named_modules() if isinstance(x, Memory)]
    return [(path, part, name) for path, part in parts for name in part._memory()]


def _refuse_coarse_memory(structure: Memory, dtype: torch.dtype) -> None:
    if dtype in (torch.float16, torch.bfloat16) and memories(structure):
        _, _, name = memories(structure)[0]
        raise ValueError(
            f"dtype={dtype} is too coarse for {name}: learned values would stand still, since "
            "what a step adds is rounded away; keep float32 or float64"
        )


def extended(memory: Tensor, rank: int, batch: list[int]) -> Tensor:
    """Long-term memory with ``rank`` dimensions of its own for each member of ``batch``."""
    own = list(memory.shape[: memory.dim() - rank])
    if batch[len(batch) - len(own) :] != own:
        raise ValueError(
            f"batch={batch} does not fit memory of batch {own}: call select(k) to keep that "
            "of one first"
        )
    return memory.expand(batch + list(memory.shape[memory.dim() - rank :])).clone()


def counted(count: Tensor, batch: list[int]) -> Tensor:
    """Counts go on for each member of ``batch``, or begin at 0 if these are other agents."""
    own = list(count.shape)
    if batch[len(batch) - len(own) :] != own:
        return torch.zeros(batch, dtype=count.dtype, device=count.device)
    return count.expand(batch).clone()

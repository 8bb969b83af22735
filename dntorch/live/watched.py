"""One part of a structure while it runs: what reaches it, its activation, what it shows."""

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from dntorch.dynamics import Dynamics
from dntorch.modules.architecture import Architecture
from dntorch.modules.elements import Passing
from dntorch.modules.field import DNF
from dntorch.modules.memory_trace import MemoryTrace
from dntorch.modules.node import NodeWTA
from dntorch.modules.relay import Relay

METHODS = ("relaxed", "relax", "euler", "forward")
"""What takes the input of a part, the innermost first: each calls at most those before it."""
KINDS = (DNF, NodeWTA, MemoryTrace)


class Watched:
    """A part whose input is noted, and added to by hand.

    The part belongs to the copy that a session steps: the method that takes its input is replaced
    on this one object.

    Attributes:
        input: what reached it in the last step, with what was added.
        added: by hand; None for nothing.
    """

    def __init__(self, label: str, part: Any) -> None:
        self.label, self.part = label, part
        self.relay = isinstance(part, Relay)
        self.shape = list(part.shape) if self.relay else list(self._state().shape)
        self.input = torch.zeros(self.shape)
        self.added: Tensor | None = None
        name = next(each for each in METHODS if hasattr(part, each))
        own = getattr(part, name)

        def noted(input: Tensor, *rest: Any) -> Any:
            if self.added is not None:
                input = input + self.added.to(input)
            self.input = input
            return own(input, *rest)

        setattr(part, name, noted)

    def _state(self) -> Tensor:
        (entry,) = self.part.flat(self.part.state).values()
        return entry

    def activation(self) -> Tensor:
        return self.input if self.relay else self._state()

    def output(self) -> Tensor:
        if self.relay:
            added, self.added = self.added, None  # it is in the input already
            shown, self.added = self.part(self.input), added
            return shown
        return self.part.output(self.part.state)


def watch(structure: Dynamics) -> dict[str, Watched]:
    """The fields, nodes, traces and relays of a structure, by name."""
    return {label: Watched(label, part) for label, part in _parts(structure)}


def _parts(structure: Dynamics) -> Iterator[tuple[str, Any]]:
    if isinstance(structure, Architecture):
        for element in structure.elements.values():
            yield element.label, element.relay if isinstance(element, Passing) else element.part
    elif isinstance(structure, KINDS):
        yield "trace" if isinstance(structure, MemoryTrace) else "field", structure
    else:
        for path, part in structure.named_modules():
            if isinstance(part, KINDS):
                yield path, part

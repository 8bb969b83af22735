"""The elements of an architecture: each with what reaches it, and what it shows."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from dntorch.cells.field import FieldState
from dntorch.checks import refuse_input
from dntorch.dynamics import Dynamics
from dntorch.modules.projection import Projection
from dntorch.modules.relay import Relay
from dntorch.modules.wiring import escaped
from dntorch.parameters import Lasting
from dntorch.plumbing import overwrite


def check_stimulus(name: str, value: Any) -> None:
    """Raise unless it is a tensor of finite numbers."""
    if not isinstance(value, Tensor):
        refuse_input(name, value)
    if value.is_complex():
        raise TypeError(f"{name} of dtype {value.dtype} is no stimulus: give floats")
    if not value.is_meta and not bool(value.isfinite().all()):
        raise ValueError(f"{name} is not finite: give numbers")


class Stimulus(Lasting):
    """An input by name: what is given is added to a constant ``value``, by default zeros."""

    value: Tensor

    def __init__(self, label: str, value: Tensor) -> None:
        super().__init__()
        self.label = label
        self.register_buffer("value", value, persistent=False)

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "value":
            check_stimulus(name, value)
            if value.shape != self.value.shape:
                raise ValueError(
                    f"value of shape {list(value.shape)} does not fit {list(self.value.shape)} of "
                    f"{self.label!r}: reshape it"
                )
            value = value.to(self.value)
        super().__setattr__(name, value)

    def shows(self, given: dict[str, Tensor]) -> Tensor:
        return self.value + given[self.label] if self.label in given else self.value

    def extra_repr(self) -> str:
        return f"{self.label!r}, {list(self.value.shape)}"


class Arm(nn.Module):
    """A link on its way into an element."""

    def __init__(self, source: str, projection: Projection) -> None:
        super().__init__()
        self.source, self.projection = source, projection

    def forward(self, shown: dict[str, Tensor]) -> Tensor:
        return self.projection(shown[self.source])

    def extra_repr(self) -> str:
        return f"from {self.source!r}"


class Element(Lasting):
    """What stands under a label, a structure or a `Relay`, with its links.

    Gathers what reaches it; a `Member` or a `Passing` says what comes of it.

    Attributes:
        label: its name in inputs, outputs and states; ``path``: of the buffer of its state.
        kept: whether the state of the architecture has an entry for it.
        passing: whether it is a relay.
    """

    shape: list[int]

    def __init__(self, label: str, shape: list[int], arms: list[Arm]) -> None:
        super().__init__()
        self.label, self.shape = label, shape
        self.kept, self.passing, self.product = True, False, False
        self.arms = nn.ModuleList(arms)
        self.register_buffer("nothing", torch.zeros(shape), persistent=False)

    def gather(self, shown: dict[str, Tensor], given: dict[str, Tensor]) -> Tensor:
        """What reaches it, from what others show and what is given by hand."""
        reaching: list[Tensor] = []
        for arm in self.arms:
            reaching.append(arm(shown))
        total = self.nothing
        for k, each in enumerate(reaching):
            if k == 0:
                total = each
            else:
                total = total * each if self.product else total + each
        return total + given[self.label] if self.label in given else total

    def extra_repr(self) -> str:
        return repr(self.label)


class Elements(nn.ModuleDict):
    """Elements by name, in the sequence of their steps.

    TorchScript takes two whose elements have the same names and types for one, and steps both in
    the sequence of the first, unless a constant tells them apart.
    """

    __constants__ = ("sequence",)

    def __init__(self, sequence: Sequence[str]) -> None:
        super().__init__()
        self.sequence = tuple(sequence)


class Member(Element):
    """A structure whose state is one tensor, called ``entry``."""

    def __init__(self, label: str, part: Dynamics, entry: str, arms: list[Arm]) -> None:
        held = part.flat(part.state)[entry]
        super().__init__(label, list(held.shape[part.origin.dim() :]), arms)
        self.part, self.entry = part, entry
        self.path = f"elements.{escaped(label)}.part.{entry}"

    def held(self) -> Tensor:
        return self.part.flat(self.part.state)[self.entry]

    def write(self, x: Tensor) -> None:
        self.part.write(self.part.nested({self.entry: x}))

    def rest(self, batch: list[int]) -> Tensor:
        return self.part.flat(self.part.initial(batch))[self.entry]

    def reset(self, rest: Tensor) -> None:
        self.part.reset()  # which keeps what it learned

    def forget(self) -> None:
        self.part.forget()

    def shows(self, x: Tensor) -> Tensor:
        return self.part.output(self.part.nested({self.entry: x}))

    def advance(self, reaching: Tensor, shown: Tensor, x: Tensor) -> Tensor:
        ahead = self.part.euler(reaching, self.part.nested({self.entry: x}))
        return self.part.flat(ahead)[self.entry]


class Field(Member):
    """A `DNF`, whose output is not computed again: it is what the field shows to others."""

    def advance(self, reaching: Tensor, shown: Tensor, x: Tensor) -> Tensor:
        if self.part.substeps > 1:
            return self.part.euler(reaching, FieldState(x)).u
        return self.part.relaxed(reaching, shown, FieldState(x)).u


class Passing(Element):
    """A relay; ``kept`` if one that steps before it reads it, a step late."""

    shape: list[int]
    shown: Tensor

    def __init__(self, label: str, relay: Relay, arms: list[Arm], kept: bool) -> None:
        super().__init__(label, relay.shape, arms)
        self.relay, self.product = relay, relay.combine == "product"
        self.kept, self.passing = kept, True
        self.path = f"elements.{escaped(label)}.shown"
        self.register_buffer("shown", torch.zeros(relay.shape if kept else 0), persistent=False)

    def held(self) -> Tensor:
        return self.shown.clone()

    def write(self, x: Tensor) -> None:
        overwrite(self.shown, x)

    def rest(self, batch: list[int]) -> Tensor:
        return self.nothing.expand(batch + self.shape).clone()

    def reset(self, rest: Tensor) -> None:
        self.write(rest)

    def forget(self) -> None:
        pass

    def shows(self, x: Tensor) -> Tensor:
        return x

    def advance(self, reaching: Tensor, shown: Tensor, x: Tensor) -> Tensor:
        ahead = self.relay(reaching)
        if self.kept:  # in the batch of the state, though nothing that reaches it has one
            return ahead + torch.zeros_like(x)
        return ahead

"""What an architecture is given by name: checked before it is built."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from dntorch.cells.kernels import sites
from dntorch.checks import check_ends, check_named, shown
from dntorch.dynamics import Dynamics
from dntorch.modules.elements import check_stimulus
from dntorch.modules.relay import Relay


def checked(elements: Mapping[str, Any]) -> dict[str, Any]:
    """Structures and relays by name; or raise."""
    if not isinstance(elements, Mapping):
        raise TypeError(f"elements={shown(elements)} is no mapping: give names and structures")
    for label, part in elements.items():
        if not isinstance(label, str) or not label:
            raise ValueError(f"elements has the name {shown(label)}: give text")
        if not isinstance(part, (Dynamics, Relay)):
            raise TypeError(
                f"elements[{label!r}] is a {type(part).__name__}: give a DNF, NodeWTA, MemoryTrace "
                "or Relay"
            )
    members = {label: part for label, part in elements.items() if isinstance(part, Dynamics)}
    if not members:
        raise ValueError(f"elements={list(elements)}: give at least one with a state, such as DNF")
    first = next(iter(members))
    for label, part in members.items():  # of which a composite would round all but one
        own, dtype = part.origin.dtype, members[first].origin.dtype
        if own != dtype:
            raise ValueError(
                f"elements[{label!r}] of dtype {own} does not fit the {dtype} of {first!r}: build "
                "all with one dtype"
            )
    return dict(elements)


def entry_of(label: str, part: Dynamics) -> str:
    """The name of the one tensor of its state."""
    names = list(part.flat(part.state))
    takes = list(part._arguments) and hasattr(part, "euler") and hasattr(part, "output")
    if len(names) != 1 or not takes:
        raise ValueError(
            f"elements[{label!r}], a {type(part).__name__}, has a state of {len(names)} tensors: "
            "give a structure whose state is one, with euler and output"
        )
    return names[0]


def shape_of(part: Any) -> list[int]:
    """Sites of each axis, without the batch."""
    if isinstance(part, Relay):
        return part.shape
    rest = part.flat(part.state)
    return list(next(iter(rest.values())).shape[part.origin.dim() :]) if rest else []


def constants(inputs: Any, like: Tensor) -> dict[str, Tensor]:
    """Constants of inputs by name, in one dtype; or raise."""
    if inputs is None:
        return {}
    check_named("inputs", inputs)
    values = {}
    for label, given in inputs.items():
        if not isinstance(label, str) or not label:
            raise ValueError(f"inputs has the name {shown(label)}: give text")
        name = f"inputs[{label!r}]"
        if isinstance(given, Tensor):
            check_stimulus(name, given)
            values[label] = given.detach().to(like, copy=True)
        else:
            values[label] = torch.zeros(sites(given, name))
    return values


def check_inputs(inputs: dict[str, Tensor], shapes: dict[str, list[int]]) -> None:
    """Raise unless what a step is given has labels and shapes that are there."""
    for label, given in inputs.items():
        if label not in shapes:
            raise ValueError(
                f"inputs has '{label}', which is no element: choose from {list(shapes.keys())}"
            )
        check_ends(label, given, shapes[label])

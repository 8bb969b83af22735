"""The boundary of a structure: nested states as a flat list of named tensors, and back.

Formats for other machines know tensors with names, not ``NamedTuple`` s. Names are paths:
``behaviors.intention.u`` is ``state.behaviors.intention.u``.
"""

import copy
import inspect
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.dynamics import Dynamics

SWITCHES = ("learning",)
"""Names of buffers that are neither state nor constant: they stay inputs of a function."""


class Port(NamedTuple):
    """A tensor that goes in or comes out."""

    name: str
    shape: list[int]
    dtype: torch.dtype

    @classmethod
    def of(cls, name: str, value: Tensor) -> "Port":
        return cls(name, list(value.shape), value.dtype)


class Boundary:
    """Names, shapes and dtypes of all that goes into and comes out of one step.

    Args:
        structure: any structure of this library, or one of your own that keeps its contract.
            It is copied, since exported programs share memory with what they came from.
        inputs: an example of each input of ``step``; shapes and dtypes are those exported.

    >>> from dntorch import NodeWTA
    >>> boundary = Boundary(NodeWTA(3), torch.zeros(3))
    >>> [port.name for port in boundary.inputs + boundary.outputs + boundary.state]
    ['input', 'output', 'u']
    """

    def __init__(self, structure: Dynamics, *inputs: Tensor) -> None:
        self.structure = copy.deepcopy(structure).eval()
        names = list(inspect.signature(structure.step).parameters)[: len(inputs)]
        self.inputs = [Port.of(name, value) for name, value in zip(names, inputs, strict=True)]
        state = self.structure.state
        self._state = pytree.tree_structure(state)
        self.state = [Port.of(name, leaf) for name, leaf in self.flatten(state).items()]
        self.switches = [
            Port.of(name, buffer)
            for name, buffer in self.structure.named_buffers()
            if name.rpartition(".")[2] in SWITCHES
        ]
        with torch.no_grad():
            output, _ = self.structure.step(*inputs, state)
        leaves = pytree.tree_leaves(output)
        single = "action" if "observation" in names else "output"
        self.outputs = [
            Port.of(single if len(leaves) == 1 else f"{single}_{k}", leaf)
            for k, leaf in enumerate(leaves)
        ]

    def flatten(self, state: Any) -> dict[str, Tensor]:
        """The tensors of a nested state by name, in the order of its fields."""
        return {
            ".".join(map(_step_name, path)): leaf
            for path, leaf in pytree.tree_flatten_with_path(state)[0]
        }

    def unflatten(self, leaves: dict[str, Tensor] | list[Tensor] | tuple[Tensor, ...]) -> Any:
        """The nested state of named tensors, or of tensors in the order of ``state``."""
        if isinstance(leaves, dict):
            leaves = [leaves[port.name] for port in self.state]
        return pytree.tree_unflatten(list(leaves), self._state)

    def buffers(self) -> dict[str, str]:
        """For each tensor of the state the buffer that holds it: found by moving it."""
        probe = copy.deepcopy(self.structure)
        rest, found = probe.state, {}
        for name in self.flatten(rest):
            probe.state = rest
            before = probe.snapshot()
            moved = self.flatten(rest)
            moved[name] = moved[name] + 1
            probe.state = self.unflatten(moved)
            after = probe.snapshot()
            (found[name],) = [key for key in after if not torch.equal(after[key], before[key])]
        return found

    def learned(self) -> set[str]:
        """Names of the tensors of the state that are long-term memory."""
        persistent = self.structure.state_dict().keys()
        return {name for name, buffer in self.buffers().items() if buffer in persistent}


def _step_name(key: Any) -> str:
    for attribute in ("name", "key", "idx"):
        if hasattr(key, attribute):
            return str(getattr(key, attribute))
    return str(key)

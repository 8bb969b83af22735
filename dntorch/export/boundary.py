"""The boundary of a structure: what goes into and comes out of one step, as tensors by name.

Formats for other machines know tensors with names, neither nested states nor observations.
An input has the name of the parameter of ``step``, or its key in the observation. A tensor of
the state has its name in ``structure.flat``, which is also that of the buffer that holds it:
``behaviors.intention.u``. Inputs and outputs of a structure that speaks in labels of any letters,
such as an `Architecture`, have the `escaped` form of the label: ``stimulus_x20_1``.
"""

import copy
import inspect
import keyword
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.dynamics import Dynamics
from dntorch.modules.wiring import escaped

SWITCHES = ("learning",)
"""Names of buffers that are neither state nor constant: they stay inputs of a function."""

Input = Tensor | dict[str, Tensor]
"""An argument of ``step``: a tensor, or an observation."""


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
        inputs: an example of each input of ``step``; shapes and dtypes are those exported. Of an
            observation only what the structure senses is exported.

    Raises:
        TypeError: what is no structure.
        ValueError: another number of inputs; two tensors with the same name; a key that cannot name
            an argument; a state whose names are not those of buffers.

    >>> from dntorch import DNSarsa, NodeWTA
    >>> boundary = Boundary(NodeWTA(3), torch.zeros(3))
    >>> [port.name for port in boundary.inputs + boundary.outputs + boundary.state]
    ['input', 'output', 'u']
    >>> seen = {"match": torch.zeros(2), "image": torch.zeros(39, 52, 3)}
    >>> boundary = Boundary(DNSarsa(2), seen, torch.zeros(()), torch.zeros(2))
    >>> [port.name for port in boundary.inputs + boundary.outputs]
    ['match', 'reward', 'noise', 'action']
    """

    def __init__(self, structure: Dynamics, *inputs: Input) -> None:
        if not isinstance(structure, Dynamics):
            raise TypeError(f"structure is a {type(structure).__name__}: give one of this library")
        *wanted, _ = inspect.signature(structure.step).parameters
        if len(inputs) != len(wanted):
            raise ValueError(
                f"inputs has {len(inputs)} entries, {type(structure).__name__}.step takes {wanted} "
                "beside its state: give an example of each"
            )
        self.structure = copy.deepcopy(structure).eval().requires_grad_(False)
        state = self.structure.state
        with torch.no_grad():
            output, _ = self.structure.step(*inputs, state)
        self.takes = {name: _keys(structure, x) for name, x in zip(wanted, inputs, strict=True)}
        """For each parameter of ``step`` the keys of its observation, None for a tensor."""
        self.gives = list(output) if isinstance(output, dict) else None
        """The keys of an output by name, None for tensors."""
        self.inputs = [Port.of(*pair) for pair in self._pairs(inputs)]
        self.state = [Port.of(*pair) for pair in self.structure.flat(state).items()]
        buffers = dict(self.structure.named_buffers())
        self.switches = [
            Port.of(name, buffer)
            for name, buffer in buffers.items()
            if name.rpartition(".")[2] in SWITCHES
        ]
        self.outputs = self._outputs(output)
        self._check(buffers)

    def named(self, inputs: Sequence[Input]) -> dict[str, Tensor]:
        """The tensors in the arguments of a step by name of their port."""
        return dict(self._pairs(inputs))

    def arguments(self, tensors: Mapping[str, Tensor]) -> list[Input]:
        """The arguments of a step from tensors by name of their port."""
        return [
            tensors[name] if keys is None else {key: tensors[self.port(key)] for key in keys}
            for name, keys in self.takes.items()
        ]

    def port(self, key: str) -> str:
        """The name of the port of a key; where outputs have labels, inputs have labels, too."""
        if self.gives is None:
            return key
        name = escaped(key)
        return name if name.isidentifier() and not keyword.iskeyword(name) else f"input_{name}"

    def lasting(self) -> set[str]:
        """Names of the tensors of the state that outlive ``reset``: what was learned, counts."""
        return {
            f"{path}.{name}" if path else name
            for path, part in self.structure.named_modules()
            if isinstance(part, Dynamics)
            for name in part.lasting
        }

    def _pairs(self, inputs: Sequence[Input]) -> list[tuple[str, Tensor]]:
        pairs = []
        for (name, keys), value in zip(self.takes.items(), inputs, strict=True):
            if keys is None:
                pairs.append((name, value))
            else:
                pairs += [(self.port(key), value[key]) for key in keys]
        return pairs

    def _outputs(self, output: Any) -> list[Port]:
        if self.gives is not None:
            return [Port.of(f"output_{escaped(key)}", output[key]) for key in self.gives]
        leaves = pytree.tree_leaves(output)
        acts = any(keys is not None for keys in self.takes.values())
        single = "action" if acts else "output"
        return [
            Port.of(single if len(leaves) == 1 else f"{single}_{k}", leaf)
            for k, leaf in enumerate(leaves)
        ]

    def _check(self, buffers: Mapping[str, Tensor]) -> None:
        """Raise unless every tensor has a name of its own, the state's those of its buffers."""
        seen = set()
        for port in self.inputs + self.switches + self.state + self.outputs:
            if port.name in seen:
                raise ValueError(
                    f"two tensors of {type(self.structure).__name__} are called {port.name!r}: "
                    "choose another key in the observation, or another name of the input"
                )
            seen.add(port.name)
        for port in self.inputs:
            if not port.name.isidentifier() or keyword.iskeyword(port.name):
                raise ValueError(
                    f"{port.name!r} cannot name an argument: choose a key such as 'left_camera'"
                )
        for port in self.state:
            if port.name not in buffers:
                raise ValueError(
                    f"no buffer is called {port.name!r} as the state is: name each field of a "
                    "state as the buffer or the part that holds it"
                )


def _keys(structure: Any, value: Input) -> tuple[str, ...] | None:
    """Which keys of an observation a structure reads; None for a tensor."""
    return None if isinstance(value, Tensor) else tuple(getattr(structure, "senses", value))

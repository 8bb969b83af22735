"""TorchScript: a structure that holds its state, with methods that speak in named tensors.

TorchScript knows no variable number of arguments, so ``forward`` is written out for the
structure at hand. All of ``torch.jit`` is deprecated upstream; robots with an older stack, and
small C++ programs, need it.
"""

import copy

import torch
from torch import Tensor, nn

from dntorch.export.boundary import Boundary


def script(boundary: Boundary) -> torch.jit.ScriptModule:
    """A structure as a ``ScriptModule``.

    ================================  ====================================================
    method                            what it does
    ================================  ====================================================
    ``forward(*inputs)``              one step; raises for another shape or dtype
    ``reset()``                       back to rest, keeping what was learned and counted
    ``forget()``                      what was learned and counted becomes zero
    ``get_state()``                   copies of the state by name
    ``set_state(state)``              all of it; raises for what does not fit, or NaN
    ``learn(on)``                     where the structure has it
    ================================  ====================================================

    NaN in an input does what it does in the structure: an agent ignores and counts it, others
    let it spread.

    >>> from dntorch import NodeWTA
    >>> nodes = script(Boundary(NodeWTA(3), torch.zeros(3)))
    >>> nodes.get_state()
    {'u': tensor([-5., -5., -5.])}
    """

    class Shell(nn.Module):  # a class of its own each time: methods are defined once a class
        def __init__(self, structure: nn.Module) -> None:
            super().__init__()
            self.structure = structure
            self.dt = float(structure.dt)

        @torch.jit.export
        def reset(self) -> None:
            self.structure.reset()

        @torch.jit.export
        def forget(self) -> None:
            self.structure.forget()

        @torch.jit.export
        def get_state(self) -> dict[str, Tensor]:
            return self.structure.flat(self.structure.state)

        @torch.jit.export
        def set_state(self, state: dict[str, Tensor]) -> None:
            held = self.get_state()
            if sorted(state.keys()) != sorted(held.keys()):
                raise ValueError(
                    f"state with the names {list(state.keys())} does not fit: "
                    f"give {list(held.keys())}"
                )
            for name, x in held.items():
                check("state " + name, state[name], list(x.shape), x.dtype)
                if not bool(torch.isfinite(state[name]).all()):
                    raise ValueError(f"state {name} is not finite: give numbers without NaN")
            self.structure.write(self.structure.nested(state))

    scripted = torch.jit.script(Shell(copy.deepcopy(boundary.structure)))
    scripted.define(_forward(boundary))
    if hasattr(boundary.structure, "learn"):
        scripted.define("def learn(self, on: bool = True) -> None:\n    self.structure.learn(on)\n")
    return scripted


def check(what: str, value: Tensor, shape: list[int], dtype: torch.dtype) -> None:
    """Raise unless a tensor is what the structure was exported for."""
    if list(value.shape) != shape or value.dtype != dtype:
        raise ValueError(
            f"{what} of shape {list(value.shape)} and dtype {value.dtype} is not what was "
            f"exported: give shape {shape} and dtype {dtype} (dtypes: 0 uint8, 4 int64, 6 float32)"
        )


def _forward(boundary: Boundary) -> str:
    """Source of ``forward``: checked tensors, put into the arguments of the structure."""
    takes = ", ".join(f"{port.name}: Tensor" for port in boundary.inputs)
    checks = [
        f"check('input {port.name}', {port.name}, {port.shape}, {port.dtype})"
        for port in boundary.inputs
    ]
    arguments = [
        name
        if keys is None
        else "{" + ", ".join(f"{key!r}: {boundary.port(key)}" for key in keys) + "}"
        for name, keys in boundary.takes.items()
    ]
    gives = ", ".join("Tensor" for _ in boundary.outputs)
    gives = gives if len(boundary.outputs) == 1 else f"Tuple[{gives}]"
    lines = [f"def forward(self, {takes}) -> {gives}:", *checks]
    call = f"self.structure({', '.join(arguments)})"
    if boundary.gives is not None:
        lines, call = [*lines, f"output = {call}"], _listed(boundary.gives)
    return "\n    ".join([*lines, f"return {call}\n"])


def _listed(keys: list[str]) -> str:
    """The values of an output by name, as a function returns them."""
    return ", ".join(f"output[{key!r}]" for key in keys)

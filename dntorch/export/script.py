"""TorchScript: a structure that holds its state, with methods that speak in named tensors.

TorchScript knows neither variable numbers of arguments nor trees, so the methods are
written out for the structure at hand. All of ``torch.jit`` is deprecated upstream; robots
with an older stack, and small C++ programs, need it.
"""

import copy
from collections.abc import Iterable

import torch
from torch import Tensor, nn

from dntorch.export.boundary import Boundary, Port


def script(boundary: Boundary) -> torch.jit.ScriptModule:
    """A structure as a ``ScriptModule``.

    ================================  ====================================================
    method                            what it does
    ================================  ====================================================
    ``forward(*inputs)``              one step; raises for another shape or dtype, or NaN
    ``reset()``                       back to rest, keeping what was learned
    ``get_state()``                   copies of the state by name
    ``set_state(state)``              all of it; raises for what does not fit, or NaN
    ``learn(on)``, ``forget()``       where the structure has them
    ================================  ====================================================

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

    scripted = torch.jit.script(Shell(copy.deepcopy(boundary.structure)))
    for method in _methods(boundary):
        scripted.define(method)
    return scripted


def check(kind: str, port: str, value: Tensor, shape: list[int], dtype: torch.dtype) -> None:
    """Raise unless a tensor is what the structure was exported for, and finite."""
    if list(value.shape) != shape or value.dtype != dtype:
        raise ValueError(
            f"{kind} {port} of shape {list(value.shape)} and dtype {value.dtype} is not what was "
            f"exported: give shape {shape} and dtype {dtype} (dtypes: 0 uint8, 4 int64, 6 float32)"
        )
    if not bool(torch.isfinite(value).all()):
        raise ValueError(f"{kind} {port} is not finite: give numbers without NaN and infinity")


def check_names(given: list[str], known: list[str]) -> None:
    """Raise unless a state has the names that it should."""
    if sorted(given) != sorted(known):
        raise ValueError(f"state with the names {given} does not fit: give {known}")


def _methods(boundary: Boundary) -> Iterable[str]:
    """Source of each method."""
    names = [port.name for port in boundary.inputs]
    output = "Tensor"
    if len(boundary.outputs) > 1:
        output = f"Tuple[{', '.join('Tensor' for _ in boundary.outputs)}]"
    yield _function(
        f"forward(self, {', '.join(f'{name}: Tensor' for name in names)}) -> {output}",
        *(_check("input", port, port.name) for port in boundary.inputs),
        f"output = self.structure({', '.join(names)})",
        *(
            _check("output", port, "output" if output == "Tensor" else f"output[{k}]")
            for k, port in enumerate(boundary.outputs)
        ),
        "return output",
    )
    buffers = {name: f"self.structure.{buffer}" for name, buffer in boundary.buffers().items()}
    yield _function(
        "get_state(self) -> Dict[str, Tensor]",
        "state: Dict[str, Tensor] = {}",
        *(f"state['{name}'] = {buffer}.clone()" for name, buffer in buffers.items()),
        "return state",
    )
    known = f"[{', '.join(repr(port.name) for port in boundary.state)}]"
    yield _function(
        "set_state(self, state: Dict[str, Tensor]) -> None",
        f"known: List[str] = {known}",
        "check_names(list(state.keys()), known)",
        *(_check("state", port, f"state['{port.name}']") for port in boundary.state),
        *(f"{buffer}.copy_(state['{name}'])" for name, buffer in buffers.items()),
    )
    if hasattr(boundary.structure, "learn"):
        yield _function("learn(self, on: bool = True) -> None", "self.structure.learn(on)")
    if hasattr(boundary.structure, "forget"):
        yield _function("forget(self) -> None", "self.structure.forget()")


def _function(signature: str, *lines: str) -> str:
    return "\n    ".join([f"def {signature}:", *lines]) + "\n"


def _check(kind: str, port: Port, value: str) -> str:
    return f"check('{kind}', '{port.name}', {value}, {port.shape}, {port.dtype})"

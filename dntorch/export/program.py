"""``torch.export`` and what is made from it: a pure function of named tensors.

Functional, not stateful, in all formats: a program that mutates buffers exports to ONNX
without an error and then stands still, and ExecuTorch forgets their initial values. Here
whoever runs a program holds its state, and can see, save and set it.
"""

import contextlib
import inspect
import io
import logging
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.utils import _pytree as pytree

from dntorch.export.boundary import Boundary
from dntorch.extras import require
from dntorch.files import write_atomically

NEXT = "next."
"""Before the names of state tensors that come out."""


class Functional(nn.Module):
    """``(*inputs, *switches, *state) -> (*outputs, *state)``, all plain tensors."""

    def __init__(self, boundary: Boundary) -> None:
        super().__init__()
        self.boundary = boundary
        self.core = _Core(boundary.structure)
        ports = boundary.inputs + boundary.switches + boundary.state
        self.takes = [port.name for port in ports]
        self.gives = [port.name for port in boundary.outputs]
        self.gives += [NEXT + port.name for port in boundary.state]
        self.forward = self._named()  # what torch.export complains about then has its name

    def _named(self) -> Callable[..., tuple[Tensor, ...]]:
        def forward(*tensors: Tensor) -> tuple[Tensor, ...]:
            return self.step(*tensors)

        kind = inspect.Parameter.POSITIONAL_ONLY
        names = [inspect.Parameter(name.replace(".", "_"), kind) for name in self.takes]
        forward.__signature__ = inspect.Signature(names)
        return forward

    def step(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        given, boundary = dict(zip(self.takes, tensors, strict=True)), self.boundary
        switches = {f"structure.{port.name}": given[port.name] for port in boundary.switches}
        state = boundary.structure.nested({port.name: given[port.name] for port in boundary.state})
        arguments = (*boundary.arguments(given), state)
        output, ahead = torch.func.functional_call(self.core, switches, arguments)
        after = boundary.structure.flat(ahead)
        return *pytree.tree_leaves(output), *(after[port.name] for port in boundary.state)

    def example(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Arguments: these inputs, switches on, the structure's state."""
        structure = self.boundary.structure
        switches = [structure.get_buffer(port.name).clone() for port in self.boundary.switches]
        return (*inputs, *switches, *structure.flat(structure.state).values())


class _Core(nn.Module):
    def __init__(self, structure: nn.Module) -> None:
        super().__init__()
        self.structure = structure

    def forward(self, *arguments):
        return self.structure.step(*arguments)


def program(functional: Functional, *inputs: Tensor) -> torch.export.ExportedProgram:
    """The ``torch.export`` program of one step."""
    with torch.no_grad(), _quiet():
        return torch.export.export(functional, functional.example(*inputs))


def write_export(
    exported: torch.export.ExportedProgram, functional: Functional, path: Path
) -> None:
    content = io.BytesIO()
    torch.export.save(exported, content)
    write_atomically(path, lambda file: file.write(content.getbuffer()))


def write_onnx(exported: torch.export.ExportedProgram, functional: Functional, path: Path) -> None:
    require("onnx", "onnxscript")
    names = {"input_names": functional.takes, "output_names": functional.gives}
    with _quiet():
        made = torch.onnx.export(exported, **names, dynamo=True, verbose=False)
    content = made.model_proto.SerializeToString()
    write_atomically(path, lambda file: file.write(content))


def write_aotinductor(
    exported: torch.export.ExportedProgram, functional: Functional, path: Path
) -> None:
    with _quiet():
        torch._inductor.aoti_compile_and_package(exported, package_path=str(path))


def write_executorch(
    exported: torch.export.ExportedProgram, functional: Functional, path: Path
) -> None:
    require("executorch")
    from executorch.exir import to_edge

    # PyTorch's own decomposition of lerp copies strides, for which ExecuTorch has no kernel.
    plain = exported.run_decompositions({torch.ops.aten.lerp.Scalar: _lerp})
    content = to_edge(plain).to_executorch().buffer
    write_atomically(path, lambda file: file.write(content))


def _lerp(start: Tensor, end: Tensor, weight: float) -> Tensor:
    """As `torch.lerp` computes it."""
    if weight < 0.5:
        return start + weight * (end - start)
    return end - (end - start) * (1 - weight)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what PyTorch says to its own developers: of torchvision, of deprecated parts."""
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)

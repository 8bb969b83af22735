"""A directory of artefacts: one structure in several formats, and how to check them."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import dntorch
from dntorch.dynamics import Dynamics
from dntorch.export import program, reading
from dntorch.export.boundary import Boundary, Input, Port
from dntorch.export.golden import Golden, record
from dntorch.export.program import Functional
from dntorch.export.script import script
from dntorch.export.verify import checking_program
from dntorch.files import write_atomically

RUNTIMES = {
    "torchscript": ".ts",
    "export": ".pt2",
    "onnx": ".onnx",
    "aotinductor": ".aoti.pt2",
    "executorch": ".pte",
}
DEFAULT = ("torchscript", "export", "onnx")
_WRITERS = {
    "export": program.write_export,
    "onnx": program.write_onnx,
    "aotinductor": program.write_aotinductor,
    "executorch": program.write_executorch,
}


def export_structure(
    structure: Dynamics,
    folder: str | Path,
    inputs: Sequence[Sequence[Input]],
    runtimes: Sequence[str] = DEFAULT,
    name: str = "structure",
) -> Path:
    """Export any structure, with a record of what it does with ``inputs``, one row per step."""
    if len(inputs) == 0 or not all(isinstance(row, tuple | list) for row in inputs):
        raise ValueError("inputs: give one tuple of inputs per step, such as [(input,)] * 20")
    folder = Path(folder)
    boundary = Boundary(structure, *inputs[0])
    rows = iter(inputs)
    golden = record(boundary, lambda step, outcome: (next(rows), {}), len(inputs))
    return write(boundary, golden, folder, runtimes, name)


def write(
    boundary: Boundary,
    golden: Golden,
    folder: Path,
    runtimes: Sequence[str] = DEFAULT,
    name: str = "structure",
    about: dict[str, Any] | None = None,
) -> Path:
    """Write artefacts, golden record, manifest and the checking program; returns the folder.

    The state at rest, with what was learned, is that of ``boundary.structure``.
    """
    unknown = [runtime for runtime in runtimes if runtime not in RUNTIMES]
    if unknown:
        raise ValueError(f"runtime {unknown[0]!r} is unknown: choose from {', '.join(RUNTIMES)}")
    folder.mkdir(parents=True, exist_ok=True)
    for leftover in (reading.MANIFEST, *(name + suffix for suffix in RUNTIMES.values())):
        (folder / leftover).unlink(missing_ok=True)
    files = {}
    if "torchscript" in runtimes:
        path = folder / f"{name}.ts"
        scripted = script(boundary).save_to_buffer()
        write_atomically(path, lambda file: file.write(scripted))
        files[path.name] = {"runtime": "torchscript"}
    if set(runtimes) - {"torchscript"}:
        functional = Functional(boundary)
        exported = program.program(functional, *(_example(port) for port in boundary.inputs))
        for runtime in (r for r in RUNTIMES if r in runtimes and r in _WRITERS):
            path = folder / f"{name}{RUNTIMES[runtime]}"
            _WRITERS[runtime](exported, functional, path)
            files[path.name] = {"runtime": runtime}
    arrays, checking = golden.arrays(), checking_program().encode()
    write_atomically(folder / reading.GOLDEN, lambda file: np.savez(file, **arrays))
    write_atomically(folder / "verify.py", lambda file: file.write(checking))
    files[reading.GOLDEN] = {}
    files["verify.py"] = {}
    for file, entry in files.items():
        entry["bytes"] = (folder / file).stat().st_size
        entry["sha256"] = checksum(folder / file)
    content = describe(boundary, name) | (about or {}) | {"files": files}
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_atomically(folder / reading.MANIFEST, lambda file: file.write(text.encode()))
    return folder


def describe(boundary: Boundary, name: str) -> dict[str, Any]:
    """The manifest of any structure."""
    buffers, lasting = dict(boundary.structure.named_buffers()), boundary.lasting()
    return {
        "format": reading.FORMAT,
        "name": name,
        "structure": type(boundary.structure).__name__,
        "dntorch": dntorch.__version__,
        "torch": torch.__version__,
        "dt": boundary.structure.dt,
        "inputs": [_port(port) for port in boundary.inputs],
        "switches": [_port(p) | {"rest": _rest(buffers[p.name])} for p in boundary.switches],
        "outputs": [_port(port) for port in boundary.outputs],
        "state": [
            _port(p) | {"rest": _rest(buffers[p.name]), "lasting": p.name in lasting}
            for p in boundary.state
        ],
        "thresholds": {},
        "tolerance": reading.TOLERANCE,
    }


def checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _port(port: Port) -> dict[str, Any]:
    return {"name": port.name, "shape": port.shape, "dtype": str(port.dtype).split(".")[1]}


def _rest(value: Tensor) -> Any:
    """One number if all are the same, else nested lists."""
    first = value.flatten()[:1]
    return first.item() if bool((value == first).all()) else value.tolist()


def _example(port: Port) -> Tensor:
    return torch.zeros(port.shape, dtype=port.dtype)

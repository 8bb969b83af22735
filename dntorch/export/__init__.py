"""Structures and agents that run without this package: artefacts, a manifest, a record.

=====================  ===============================================================
file                   what it is
=====================  ===============================================================
``NAME.ts``            TorchScript: holds its state; inputs in, outputs out; in C++ too
``NAME.pt2``           ``torch.export`` program: a pure function, state in and out
``NAME.onnx``          the same function for ONNX Runtime
``NAME.aoti.pt2``      the same function compiled by AOTInductor, on request
``NAME.pte``           the same function for ExecuTorch, on request
``manifest.json``      what goes in and out, the state at rest, checksums
``golden.npz``         what the eager structure did, to compare with
``verify.py``          compares, on any machine; needs NumPy and a runtime, not dntorch
=====================  ===============================================================
"""

from dntorch.export.agent import export_agent
from dntorch.export.artefacts import RUNTIMES, export_structure
from dntorch.export.boundary import Boundary
from dntorch.export.program import Functional
from dntorch.export.script import script
from dntorch.export.verify import verify

__all__ = [
    "RUNTIMES",
    "Boundary",
    "Functional",
    "export_agent",
    "export_structure",
    "script",
    "verify",
]

"""Structures, kernels and arrays in the words of COSIVINA's parameters."""

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from dntorch.cells.kernels import Gauss, gauss_matrix, per_axis
from dntorch.cells.memory_trace import share
from dntorch.cosivina.elements import TICK
from dntorch.cosivina.files import Size
from dntorch.modules.field import DNF
from dntorch.modules.memory_trace import MemoryTrace

MS = 1 / TICK
"""COSIVINA's units of time per second."""


def field(label: str, part: DNF, size: list[int]) -> dict[str, Any]:
    """Parameters of a ``NeuralField``; or raise where it has no such form."""
    linear = (part.kind, part.steepness, part.threshold) == ("linear", 1.0, 0.0)
    usual = (part.kind, part.threshold) == ("logistic", 0.0) or linear
    if not usual or part.substeps != 1 or part.integrator != "euler":
        raise ValueError(
            f"element {label!r}: COSIVINA's fields are logistic with threshold 0 and take one "
            f"Euler step, this one is {part.kind!r} with threshold={part.threshold}, "
            f"substeps={part.substeps}, integrator={part.integrator!r}"
        )
    tau, h = _one(label, "tau", part.tau), _one(label, "h", part.h)
    return {"size": size, "tau": rounded(tau * MS), "h": h, "beta": part.steepness}


def trace(label: str, part: MemoryTrace, size: list[int]) -> dict[str, Any]:
    """Parameters of a ``MemoryTrace``; or raise."""
    if not part.frozen:
        raise ValueError(f"element {label!r}: COSIVINA's memory traces are frozen: set frozen=True")
    build, decay = (_one(label, n, getattr(part, n)) for n in ("tau_build", "tau_decay"))
    return {
        "size": size,
        "tauBuild": rounded(1 / share(build, part.dt)),
        "tauDecay": rounded(1 / share(decay, part.dt)),
        "threshold": part.threshold,
    }


def _one(label: str, name: str, number: Any) -> float:
    if isinstance(number, Tensor) and number.dim() > 0:
        raise ValueError(f"element {label!r}: {name} has one number per agent: select(k) one first")
    return float(number)


def shifted(term: Gauss) -> bool:
    """Whether its middle is not where its cause is."""
    shift = term.shift if isinstance(term.shift, (tuple, list)) else (term.shift,)
    return any(float(s) != 0 for s in shift)


def amplified_matrix(term: Gauss, n: int, border: str) -> Tensor:
    """A term on a line as one matrix."""
    sigma, shift = (per_axis("", x, 1)[0] for x in (term.sigma, term.shift))
    return term.amplitude * gauss_matrix(n, sigma, border, shift, term.cutoff, term.normalized)


def size_of(shape: Sequence[int]) -> Size:
    """A shape as MATLAB has it, of two axes at least."""
    return (*(1,) * (2 - len(shape)), *shape)


def array(value: Tensor) -> Any:
    """An array as JSONLab writes it."""
    value = value.detach().double()
    if value.dim() < 3:
        return value.tolist()
    backwards = value.permute(*reversed(range(value.dim())))  # column after column
    data = [[x] for x in backwards.flatten().tolist()]
    return {"_ArrayType_": "double", "_ArraySize_": list(value.shape), "_ArrayData_": data}


def rounded(number: float) -> float:
    """A number without what a change of units left behind."""
    return float(f"{number:.12g}")

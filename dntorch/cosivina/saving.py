"""Architectures as COSIVINA parameter files."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dntorch.cells.kernels import Gauss, Global, per_axis
from dntorch.checks import shown
from dntorch.cosivina import written
from dntorch.cosivina.files import Element, name_of, write
from dntorch.cosivina.written import MS, array, rounded, size_of
from dntorch.modules.architecture import Architecture
from dntorch.modules.field import DNF
from dntorch.modules.memory_trace import MemoryTrace
from dntorch.modules.projection import Projection
from dntorch.modules.relay import Relay

Port = tuple[str, str]
"""Label and component of what is read."""


def save(architecture: Architecture, path: str | Path, noise: Sequence[str] = ()) -> None:
    """Write an architecture as a COSIVINA parameter file.

    Fields become ``NeuralField``, traces ``MemoryTrace``, stimuli ``CustomStimulus``; kernels and
    links become one element per step, such as ``SumDimension``, ``GaussKernel1D`` and
    ``ExpandDimension2D``. COSIVINA steps elements one after the other: in the file fields stand
    first and what couples them last, so that all read what was there a step before; an
    architecture with an ``order`` keeps it. In the very first step couplings are still silent.

    Args:
        architecture: of `DNF`, `MemoryTrace` and `Relay`.
        path: of the file; what it held before stays whole until all is written.
        noise: inputs that become ``NormalNoise`` of sd 1; the others are silent or constant.

    Raises:
        ValueError: what has no element in COSIVINA: another structure, another output function,
            numbers per agent, a maximum, a kernel of matrices over a plane. Nothing is written.
        TypeError: what is no `Architecture`, no path, no list of labels.
        OSError: the file can't be written.
    """
    if not isinstance(architecture, Architecture):
        raise TypeError(f"architecture is a {type(architecture).__name__}: give an Architecture")
    name_of(path)
    if isinstance(noise, str) or not isinstance(noise, Sequence):
        raise TypeError(f"noise={shown(noise)} is no list: give labels of inputs, such as ['xi']")
    inputs = [stimulus.label for stimulus in architecture.stimuli.values()]
    for label in noise:
        if label not in inputs:
            raise ValueError(
                f"noise has {shown(label)}, which is no input of the architecture: choose from "
                f"{inputs}"
            )
    for label in architecture.labels():
        if not label.isprintable() and label.encode(errors="replace").decode() != label:
            raise ValueError(f"element {label!r} cannot be written in UTF-8: give another name")
    writer = _Writer(architecture, noise)
    write(path, writer.delta_t, writer.elements)


class _Writer:
    """Collects the elements of a file."""

    @torch.no_grad()  # kernels may want gradients
    def __init__(self, architecture: Architecture, noise: Sequence[str]) -> None:
        self.architecture = architecture
        self.delta_t = rounded(architecture.dt * MS)
        self.elements: list[Element] = []
        self.taken = set(architecture.labels())
        for stimulus in architecture.stimuli.values():
            self._stimulus(stimulus.label, stimulus.value, stimulus.label in noise)
        nodes = list(architecture.elements.values())
        if architecture.ordered:
            for node in nodes:
                self._node(node, self._reads(node))
            return
        members = [node for node in nodes if not node.passing]
        places = {}
        for node in members:  # first, without inputs, which come when they are written
            places[node.label] = len(self.elements)
            self._node(node, [])
        for node in nodes:
            if node.passing:
                self._node(node, self._reads(node))
        for node in members:
            reads, k = self._reads(node), places[node.label]
            self.elements[k] = self.elements[k]._replace(inputs=reads)

    def add(self, label: str, kind: str, parameters: dict[str, Any], *reads: Port) -> Port:
        self.elements.append(Element(label, kind, parameters, list(reads), ""))
        self.taken.add(label)
        return label, "output"

    def new(self, label: str) -> str:
        """A label that no other element has."""
        free, k = label, 2
        while free in self.taken:
            free, k = f"{label} ({k})", k + 1
        self.taken.add(free)
        return free

    # ------------------------------------------------------------- elements

    def _stimulus(self, label: str, value: Tensor, noisy: bool) -> None:
        size = size_of(value.shape)
        if noisy:
            parameters = {"size": list(size), "amplitude": math.sqrt(self.delta_t)}
            self.add(label, "NormalNoise", parameters)
        else:
            self.add(label, "CustomStimulus", {"size": list(size), "pattern": array(value)})

    def _node(self, node: Any, reads: list[Port]) -> None:
        part, size = self.architecture[node.label], list(size_of(node.shape))
        if isinstance(part, DNF):
            self.add(node.label, "NeuralField", written.field(node.label, part, size), *reads)
        elif isinstance(part, MemoryTrace):
            self.add(node.label, "MemoryTrace", written.trace(node.label, part, size), *reads)
        elif isinstance(part, Relay):
            self._relay(node.label, part, size, reads)
        else:
            raise ValueError(
                f"element {node.label!r}, a {type(part).__name__}, has no class in COSIVINA: save "
                "architectures of DNF, MemoryTrace and Relay"
            )

    def _relay(self, label: str, relay: Relay, size: list[int], reads: list[Port]) -> None:
        own = relay.kind == "linear"
        name = label if own else self.new(f"{label} (sum)")
        if not reads:
            zeros = array(torch.zeros(relay.shape))
            port = self.add(name, "CustomStimulus", {"size": size, "pattern": zeros})
        elif relay.combine == "sum" or len(reads) == 1:
            port = self.add(name, "SumInputs", {"size": size}, *reads)
        else:
            port = reads[0]
            for k, each in enumerate(reads[1:], 2):
                step = name if k == len(reads) else self.new(f"{label} ({k})")
                port = self.add(step, "PointwiseProduct", {"size": size}, port, each)
        if relay.kind == "logistic":
            parameters = {"beta": relay.steepness, "threshold": relay.threshold}
            self.add(label, "Sigmoid", {"size": size, **parameters}, port)
        elif (relay.kind, relay.steepness, relay.threshold) == ("semilinear", 1.0, 0.0):
            self.add(label, "HalfWaveRectification", {"size": size}, port)
        elif not own:
            raise ValueError(
                f"element {label!r}, a Relay of kind {relay.kind!r}, has no class in COSIVINA: "
                "take 'linear' or 'logistic'"
            )

    # ------------------------------------------------------------- links

    def _reads(self, node: Any) -> list[Port]:
        """What an element reads; all on the way to it is written before."""
        part = self.architecture[node.label]
        reads = [port for arm in node.arms for port in self._link(arm.source, node.label, arm)]
        if isinstance(part, DNF):
            names = [f"a{k}" for k in range(len(part.shape))]
            start = self._port(node.label)
            reads += self._kernel(f"{node.label} -> {node.label}", start, part, part.kernel, names)
        single = isinstance(part, MemoryTrace) or getattr(part, "combine", "") == "product"
        if isinstance(part, MemoryTrace) and len(reads) > 1:
            label = self.new(f"{node.label} (sum)")
            return [self.add(label, "SumInputs", {"size": list(size_of(node.shape))}, *reads)]
        if single and len(reads) > len(node.arms):
            raise ValueError(f"a kernel of several terms into {node.label!r}: put a Relay between")
        return reads

    def _port(self, label: str) -> Port:
        """What others read of an element."""
        part = self.architecture[label]
        linear = isinstance(part, DNF) and part.kind == "linear"
        return label, "activation" if linear else "output"

    def _link(self, source: str, target: str, arm: Any) -> list[Port]:
        projection: Projection = arm.projection
        name, port = f"{source} -> {target}", self._port(source)
        came, goes = (side.split() for side in projection.axes.split("->"))
        if any("+" in axis for axis in [*came, *goes]):
            raise ValueError(f"link {name!r}: diagonals are not written: see docs/cosivina.md")
        through = [axis for axis in goes if axis in came]
        lost = [k for k, axis in enumerate(came) if axis not in goes]
        count = math.prod(projection.source[k] for k in lost)
        if lost and projection.reduce not in ("sum", "mean"):
            raise ValueError(
                f"link {name!r}: reduce={projection.reduce!r} has no class in COSIVINA"
            )
        if lost:
            left = [n for n, axis in zip(projection.source, came) if axis in goes]
            gain = 1.0 if projection.reduce == "sum" else 1 / count
            port = self._sum(f"{name} (sum)", port, projection.source, lost, left, gain)
        if [axis for axis in came if axis in goes] != through:
            port = self._turn(name, port, projection)
        kernel, before = projection.kernel, len(self.elements)
        if isinstance(kernel, (float, Tensor)):
            plain = float(kernel) == 1.0 and (lost or goes != came or self.architecture.ordered)
            ports = [port] if plain else [self._scale(name, port, projection.shape, float(kernel))]
        else:
            ports = self._kernel(name, port, projection, kernel, through)
        if through and through != goes:
            ports = [self._expand(name, each, projection, through, goes) for each in ports]
        if not self.architecture.ordered and len(self.elements) == before and not lost:
            ports = [self._scale(name, port, projection.target, 1.0)]
        return ports

    def _scale(self, name: str, port: Port, shape: Sequence[int], gain: float) -> Port:
        parameters = {"size": list(size_of(shape)), "amplitude": gain}
        return self.add(self.new(name), "ScaleInput", parameters, port)

    def _sum(
        self, name: str, port: Port, shape: list[int], lost: list[int], left: list[int], gain: float
    ) -> Port:
        dims = [k + (2 if len(shape) == 1 else 1) for k in lost]
        parameters = {
            "sumDimensions": dims if len(dims) > 1 else dims[0],
            "size": list(size_of(left)),
            "amplitude": gain,
            "dimensionOrder": list(range(1, len(size_of(left)) + 1)),
        }
        return self.add(self.new(name), "SumDimension", parameters, port)

    def _turn(self, name: str, port: Port, projection: Projection) -> Port:
        if len(projection.shape) != 2:
            raise ValueError(f"link {name!r}: only planes can be transposed in COSIVINA")
        label = self.new(f"{name} (transpose)")
        return self.add(label, "Transpose", {"size": list(projection.shape)}, port)

    def _expand(
        self, name: str, port: Port, projection: Projection, through: list[str], goes: list[str]
    ) -> Port:
        label, into = self.new(f"{name} (expand)"), list(size_of(projection.target))
        places = [goes.index(axis) + 1 for axis in through]
        if len(into) == 2:
            parameters: dict[str, Any] = {"expandDimension": 3 - places[0], "size": into}
            return self.add(label, "ExpandDimension2D", parameters, port)
        size = list(size_of(projection.shape))
        mapping = places if len(places) > 1 else places[0]
        parameters = {"inputSize": size, "outputSize": into, "dimensionMapping": mapping}
        return self.add(label, "ExpandDimension", parameters, port)

    def _kernel(self, name: str, port: Port, holder: Any, kernel: Any, axes: list[str]) -> list:
        """One element for each term of a kernel."""
        shape, ports = list(holder.shape), []
        border = per_axis("border", holder.border, len(shape))
        for term in kernel:
            if isinstance(term, Global) or not axes:
                ports.append(self._whole(name, port, shape, float(term.amplitude)))
            elif isinstance(term, Gauss) and not written.shifted(term):
                ports.append(self._gauss(name, port, shape, border, term))
            elif len(axes) == 1:
                if isinstance(term, Gauss):
                    matrix = written.amplified_matrix(term, shape[0], border[0])
                else:
                    matrix = torch.as_tensor(term.matrices[0]).double()
                if matrix.shape[1] == 1:
                    raise ValueError(
                        f"{name!r}: a matrix from one site has no class in COSIVINA: take a node, "
                        "of shape (), and an expansion"
                    )
                parameters = {
                    "size": [matrix.shape[1], matrix.shape[0]],
                    "weights": array(matrix.t()),
                }
                ports.append(self.add(self.new(name), "WeightMatrix", parameters, port))
            else:
                raise ValueError(
                    f"{name!r}: a kernel of matrices, or one that is shifted, over {len(axes)} "
                    "axes has no class in COSIVINA"
                )
        return ports

    def _whole(self, name: str, port: Port, shape: list[int], gain: float) -> Port:
        if not shape:
            return self._scale(name, port, shape, gain)
        return self._sum(f"{name} (global)", port, shape, list(range(len(shape))), [], gain)

    def _gauss(
        self, name: str, port: Port, shape: list[int], border: tuple[str, ...], term: Gauss
    ) -> Port:
        ends = [""] if len(shape) == 1 else ["Y", "X", "Z"][: len(shape)]
        sigma = per_axis("sigma", term.sigma, len(shape))
        parameters: dict[str, Any] = {"size": list(size_of(shape))}
        parameters |= {f"sigma{end}": float(s) for end, s in zip(ends, sigma)}
        parameters |= {"amplitude": float(term.amplitude)}
        parameters |= {f"circular{end}": int(b == "circular") for end, b in zip(ends, border)}
        parameters |= {"normalized": int(term.normalized), "cutoffFactor": float(term.cutoff)}
        return self.add(self.new(name), f"GaussKernel{len(shape)}D", parameters, port)

"""COSIVINA parameter files as architectures."""

from pathlib import Path

import torch

from dntorch.cosivina.files import Simulator, read
from dntorch.cosivina.network import MEMBERS, SOURCES, Node, Nodes, network
from dntorch.cosivina.wiring import amplified, fused, synchronous, taken
from dntorch.modules.architecture import Architecture, Link
from dntorch.modules.field import DNF
from dntorch.modules.memory_trace import MemoryTrace
from dntorch.modules.projection import Projection
from dntorch.modules.relay import Relay


def load(
    path: str | Path, dtype: torch.dtype | None = None, first_step: bool = False
) -> Architecture:
    """A model from a COSIVINA parameter file."""
    simulator = read(path)
    nodes = network(simulator)
    nodes = nodes if first_step else fused(nodes)
    dt = simulator.delta_t * 1e-3
    kernels = {} if first_step else {
        label: taken(node) for label, node in nodes.items() if node.role == "field"
    }  # fmt: skip
    steps = sorted((n for n in nodes.values() if n.role not in SOURCES), key=lambda n: n.place)
    elements = {node.label: _element(node, dt, dtype, kernels) for node in steps}
    links = [
        Link(edge.source, node.label, _projection(nodes, edge.source, node, edge.map, dtype))
        for node in steps
        for edge in node.edges
    ]
    inputs = {
        label: node.shape if node.value is None else node.value
        for label, node in nodes.items()
        if node.role in SOURCES
    }
    ordered = first_step or not synchronous(nodes)
    order = [node.label for node in steps] if ordered else None
    return Architecture(elements, *links, inputs=inputs, order=order, filled=not first_step)


def _element(node: Node, dt: float, dtype: torch.dtype | None, kernels: dict):
    """The structure of a node; a sentence of its constructor gets the name of the element."""
    try:
        if node.role == "trace":
            return MemoryTrace(node.shape, **node.options, dt=dt, dtype=dtype)
        if node.role == "field":
            kernel, border = kernels.get(node.label, ((), "circular"))
            return DNF(node.shape, kernel, **node.options, border=border, dt=dt, dtype=dtype)
        return Relay(node.shape, **node.options)
    except ValueError as error:
        raise node.element.error(str(error)) from error


def _projection(nodes: Nodes, source: str, node: Node, map, dtype):
    try:
        return Projection(
            map.pattern, nodes[source].shape, node.shape,
            amplified(map) if map.terms else map.gain, map.border or "circular", dtype=dtype,
        )  # fmt: skip
    except ValueError as error:
        raise node.element.error(str(error)) from error

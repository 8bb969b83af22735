"""COSIVINA parameter files as architectures."""

from pathlib import Path

import torch

from dntorch.checks import shown
from dntorch.cosivina.elements import TICK
from dntorch.cosivina.files import read
from dntorch.cosivina.network import SOURCES, Node, network
from dntorch.cosivina.parts import Map
from dntorch.cosivina.wiring import amplified, fused, synchronous, taken
from dntorch.modules.architecture import Architecture, Link
from dntorch.modules.field import DNF
from dntorch.modules.memory_trace import MemoryTrace
from dntorch.modules.projection import Projection
from dntorch.modules.relay import Relay


def load(
    path: str | Path, dtype: torch.dtype | None = None, first_step: bool = False
) -> Architecture:
    r"""The model of a COSIVINA parameter file.

    ====================  ======================================================================
    COSIVINA              here
    ====================  ======================================================================
    time in steps of      ``dt = deltaT / 1000`` seconds, ``tau`` likewise: one unit is 1 ms
    ``deltaT``
    size ``[1, n]``       shape ``(n,)``; ``[1, 1]`` is ``()``, a plane ``(y, x)``
    position ``p``        ``p - 1``: sites count from 0
    label                 the same, in inputs, outputs and state, of fields, traces and inputs
    ``NormalNoise``       an input, silent unless given: give ``torch.randn(shape)``, which is
                          scaled here; see `noise`
    other stimuli         inputs that act by themselves; what is given under their label is added
    cameras, robots,      inputs, silent unless given
    timed stimuli
    kernels, sums, ...    the kernel of a field that reads itself, else links and relays
    ====================  ======================================================================

    ``docs/cosivina.md`` tells for each class of elements what becomes of it. What acts on no field
    and no trace is left out, and so are couplings with an amplitude of 0.

    Who reads what of the step before is as in COSIVINA, where elements step in the order of the
    file. In most models all fields read what the others showed a step before, as here; then there
    is no ``order``, and ``fold()`` can make the model fast. Else ``order`` is that of the file.

    **Deviations**: in COSIVINA's first step couplings that stand behind the field that reads them
    are still silent; here they are at rest. ``first_step=True`` does as COSIVINA does, with an
    element for each of the file. What is given to an input acts in the same step.

    Args:
        path: of the file.
        dtype: of all numbers; kernels are built in float64.
        first_step: whether to be exact in the first step, at the cost of speed.

    Raises:
        OSError: the file can't be read.
        ValueError: broken JSON, another kind of file, an unknown class, a parameter that is missing
            or does not fit, an input that names no element, sizes that differ, labels that repeat.
            The sentence names element, class and file.

    Source: Schneegans, "COSIVINA: a Matlab toolbox to compose, simulate, and visualize neurodynamic
    architectures", 2021. Not in the paper.

    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> from dntorch import DNF, Architecture, gauss
    >>> from dntorch.cosivina import load, save
    >>> cue = gauss(50, 20.0, 3.0, 8.0)
    >>> model = Architecture({"u": DNF(50, dt=1e-3)}, ("cue", "u"), inputs={"cue": cue})
    >>> file = Path(mkdtemp()) / "model.json"
    >>> save(model, file)
    >>> again = load(file)
    >>> for _ in range(200):
    ...     outputs = again({})
    >>> int(again.state["u"].argmax())
    20
    """
    if not isinstance(first_step, bool):
        raise TypeError(f"first_step={shown(first_step)}: give True or False")
    simulator = read(path)
    nodes = network(simulator)
    nodes = nodes if first_step else fused(nodes)
    own = (
        {} if first_step else {k: taken(node) for k, node in nodes.items() if node.role == "field"}
    )
    ordered = first_step or not synchronous(nodes)
    steps = sorted((n for n in nodes.values() if n.role not in SOURCES), key=lambda n: n.place)
    elements = {
        node.label: _element(node, simulator.delta_t * TICK, dtype, own.get(node.label, ((), ())))
        for node in steps
    }
    links = [
        Link(edge.source, node.label, _projection(nodes[edge.source], node, edge.map, dtype))
        for node in steps
        for edge in node.edges
    ]
    inputs = {
        label: node.shape if node.value is None else node.value
        for label, node in nodes.items()
        if node.role in SOURCES
    }
    order = list(elements) if ordered else None
    return Architecture(elements, *links, inputs=inputs, order=order, filled=not first_step)


def noise(path: str | Path) -> dict[str, tuple[int, ...]]:
    """The inputs of a file that are noise, with their shapes.

    Draw ``{label: torch.randn(*batch, *shape) for label, shape in noise(path).items()}`` anew for
    each step: COSIVINA's amplitude and its ``1 / sqrt(deltaT)`` are part of the model.
    """
    nodes = network(read(path))
    return {k: node.shape for k, node in nodes.items() if node.element.kind == "NormalNoise"}


def _element(
    node: Node, dt: float, dtype: torch.dtype | None, own: tuple[tuple, tuple[str, ...]]
) -> DNF | MemoryTrace | Relay:
    """The structure of a node; ``own`` is the kernel of a field with its borders."""
    try:
        if node.role == "trace":
            return MemoryTrace(node.shape, **node.options, dt=dt, dtype=dtype)
        if node.role == "field":
            kernel, border = own[0], own[1] or "circular"
            return DNF(node.shape, kernel, **node.options, border=border, dt=dt, dtype=dtype)
        return Relay(node.shape, **node.options)
    except ValueError as error:
        raise node.element.error(str(error)) from error


def _projection(source: Node, node: Node, map: Map, dtype: torch.dtype | None) -> Projection:
    kernel = amplified(map) if map.terms else map.gain
    border = map.border or "circular"
    try:
        return Projection(map.pattern, source.shape, node.shape, kernel, border, dtype=dtype)
    except ValueError as error:
        raise node.element.error(str(error)) from error

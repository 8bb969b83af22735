"""The elements of a file as a network: what reads what, through which maps."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from torch import Tensor

from dntorch.cosivina.classes import parts
from dntorch.cosivina.files import Element, Simulator, Size
from dntorch.cosivina.parts import Map, Part, names, repeat, shape

MEMBERS = ("field", "trace")
SOURCES = ("constant", "open")


class Edge(NamedTuple):
    """What a node reads."""

    source: str
    map: Map
    activation: bool = False
    """Whether it is that of a field, not its output."""


@dataclass
class Node:
    """A component of an element, or a step on the way to it."""

    label: str
    role: str
    element: Element
    place: tuple[int, int]
    """When it steps: the element's place in the file, and a place within the element."""
    size: Size
    shape: tuple[int, ...]
    options: dict[str, Any] = field(default_factory=dict)
    value: Tensor | None = None
    why: str = ""
    edges: list[Edge] = field(default_factory=list)

    @property
    def linear(self) -> bool:
        """Whether it is a relay that passes on the sum of what it reads."""
        return self.role == "relay" and not self.options

    @property
    def product(self) -> bool:
        return self.options.get("combine") == "product"


Nodes = dict[str, Node]


class Network:
    """Reads a file element by element."""

    def __init__(self, simulator: Simulator) -> None:
        self.elements = simulator.elements
        self.parts = {
            label: parts(element, simulator.delta_t) for label, element in self.elements.items()
        }
        self.places = {label: k for k, label in enumerate(self.elements)}
        self.nodes: Nodes = {}
        self.waiting: list[tuple[Node, Part]] = []
        for label, components in self.parts.items():
            default = next(iter(components))
            if components[default].role in (*MEMBERS, *SOURCES):
                self.node(label, default)
        while self.waiting:
            self._read(*self.waiting.pop(0))

    def node(self, label: str, component: str) -> Node:
        """The node of a component, made when it is first asked for; what it reads comes later."""
        element, components = self.elements[label], self.parts[label]
        part = components.get("") or components.get(component)
        if part is None:
            raise element.error(
                f"it has no component {component!r} for others: choose from {list(components)}"
            )
        default = part is next(iter(components.values()))
        name = label if default else self._name(f"{label}: {component}")
        if name not in self.nodes:
            role = part.role if part.role in (*MEMBERS, *SOURCES, "unsupported") else "relay"
            node = Node(name, role, element, (self.places[label], 1), part.size, shape(part.size))
            node.value, node.why = part.value, part.why
            self.nodes[name] = node
            if role in MEMBERS or role == "relay":
                self.waiting.append((node, part))
            else:
                node.options = part.options
        return self.nodes[name]

    def _name(self, name: str) -> str:
        while name in self.elements:
            name += "'"
        return name

    def _read(self, node: Node, part: Part) -> None:
        """The edges of a node, and the options of the structure that it becomes."""
        options = dict(part.options)
        if part.role in ("map", "sums"):
            ((source, component),) = self._inputs(node, 1)
            map = part.map or self._summed(node, options, source.size)
            self._check_size(node, source, part.reads or source.size)
            self._add(node, source, map, component)
        else:
            gain = options.pop("gain", 1.0)
            node.options = options
            wanted = {"first": 1, "trace": 1, "product": 2}.get(part.role)
            for source, component in self._inputs(node, wanted):
                map = repeat(source.size, node.size, gain)
                if map is None or (part.role == "trace" and source.shape != node.shape):
                    self._check_size(node, source, node.size)
                self._add(node, source, map, component)
            if part.role == "product":
                node.options["combine"] = "product"

    def _inputs(self, node: Node, wanted: int | None) -> list[tuple[Node, str]]:
        """Nodes of the inputs that an element uses, with the component that it reads."""
        given = node.element.inputs
        if len(given) < (wanted or 0):
            raise node.element.error(
                f"it has {len(given)} of {wanted} inputs: connect it, or take it out"
            )
        found = []
        for label, component in given[:wanted]:
            kind = self.elements[label].kind
            if (kind == "FastFourierTransform") != (node.element.kind == "KernelInverseFFT"):
                raise node.element.error(
                    f"its input {label!r} is a {kind}: a FastFourierTransform and a "
                    "KernelInverseFFT go together"
                )
            found.append((self.node(label, component), component))
        return found

    def _add(self, node: Node, source: Node, map: Map, component: str) -> None:
        """An edge; through a line of one site, where a matrix leads to a single number."""
        gain = source.options.get("gain", 1.0) if source.role == "open" else 1.0
        map = map._replace(gain=map.gain * gain)
        active = source.role == "field" and component == "activation"
        if len(map.goes) > len(node.shape):
            name, place = self._name(f"{node.label}: row"), (node.place[0], 0)
            edges = [Edge(source.label, map, active)]
            row = Node(name, "relay", node.element, place, (1, 1), (1,), edges=edges)
            self.nodes[row.label] = row
            source, map, active = row, Map(map.goes, ()), False
        node.edges.append(Edge(source.label, map, active))

    def _check_size(self, node: Node, source: Node, wanted: Size) -> None:
        flexible = node.element.kind.startswith("ExpandDimension")
        if source.size == wanted or (flexible and source.shape == shape(wanted)):
            return
        raise node.element.error(
            f"its input {source.label!r} of size {list(source.size)} does not fit "
            f"{list(wanted)}: give both the same size"
        )

    def _summed(self, node: Node, options: dict[str, Any], size: Size) -> Map:
        """Of a sum over some axes: the map, once the size of the input is known."""
        left = [k for k, n in enumerate(size, 1) if n > 1 and k not in options["over"]]
        if len(left) > 1:
            try:
                left = [left[k - 1] for k in options["order"]]
            except IndexError:
                left = []
        if tuple(size[k - 1] for k in left) != node.shape:
            raise node.element.error(
                f"what is left of an input of size {list(size)} does not fit size="
                f"{list(node.size)}: give the size of the sum"
            )
        every = names(tuple(2 for _ in size))
        return Map(names(size), tuple(every[k - 1] for k in left), options["gain"])


def network(simulator: Simulator) -> Nodes:
    """All that acts on a field or a trace, and all inputs.

    Raises:
        ValueError: an element that does not fit; the sentence names it, its class and the file.
    """
    nodes = _pruned(Network(simulator).nodes)
    for node in nodes.values():
        if node.role == "unsupported":
            raise node.element.error(f"it is not supported, since {node.why}")
    _linear_fields(nodes)
    if not any(node.role in MEMBERS for node in nodes.values()):
        raise ValueError(f"{simulator.path} has no NeuralField and no MemoryTrace: add one")
    return nodes


def _pruned(nodes: Nodes) -> Nodes:
    """Without maps of gain 0, and without what acts on no field and no trace."""
    silent = {label for label, node in nodes.items() if node.linear}
    while True:
        for node in nodes.values():
            if not node.product:
                node.edges = [
                    edge
                    for edge in node.edges
                    if edge.map.gain != 0
                    and not (edge.source in silent and not nodes[edge.source].edges)
                ]
        empty = {x for x in silent if not nodes[x].edges}
        read = {e.source for n in nodes.values() if not n.product for e in n.edges}
        if not empty & read:
            break
    live, new = set(), [label for label, node in nodes.items() if node.role in MEMBERS]
    while new:
        live |= set(new)
        new = [e.source for label in new for e in nodes[label].edges if e.source not in live]
    return {label: node for label, node in nodes.items() if label in live or node.role in SOURCES}


def _linear_fields(nodes: Nodes) -> None:
    """Fields whose activation is read have it as output."""
    for label, node in nodes.items():
        reads = [(n, e) for n in nodes.values() for e in n.edges if e.source == label]
        active = [reader.label for reader, edge in reads if edge.activation]
        if active and len(active) < len(reads):
            raise node.element.error(
                f"{active[0]!r} reads its activation, and something reads its output: give each a "
                "field of its own"
            )
        if active:
            node.options |= {"kind": "linear", "steepness": 1.0}

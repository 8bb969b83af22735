"""A network made smaller: relays that one projection can stand for, and the order of steps."""

from dntorch.cells.kernels import Gauss, Global, Matrices, gauss_matrix, per_axis
from dntorch.cosivina.network import MEMBERS, SOURCES, Edge, Node, Nodes
from dntorch.cosivina.parts import Map, chain


def late(source: Node, reader: Node) -> int:
    """1 if what is read is that of the step before, in COSIVINA's order."""
    return int(source.place >= reader.place)


def fused(nodes: Nodes) -> Nodes:
    """Without relays whose maps can be joined with those of what they read, lags kept."""
    nodes = dict(nodes)
    while any([_fuse(nodes, label) for label in list(nodes)]):
        pass
    return nodes


def _fuse(nodes: Nodes, label: str) -> bool:
    """Take a relay out if its readers can read what it reads, at no cost."""
    node = nodes[label]
    readers = [n for n in nodes.values() for e in n.edges if e.source == label]
    cheap = len(node.edges) == 1 and not node.edges[0].map.terms and _widens(node.edges[0].map)
    if not node.linear or not node.edges or not (cheap or len(readers) == 1) or node in readers:
        return False
    joined: dict[str, list[Edge]] = {}
    for reader in {n.label: n for n in readers}.values():
        edges = []
        for edge in reader.edges:
            new = _through(nodes, node, reader, edge) if edge.source == label else [edge]
            if new is None:
                return False
            edges += new
        joined[reader.label] = edges
    for name, edges in joined.items():
        nodes[name].edges = edges
    del nodes[label]
    return True


def _widens(map: Map) -> bool:
    return all(name in map.goes for name in map.came)


def _through(nodes: Nodes, node: Node, reader: Node, edge: Edge) -> list[Edge] | None:
    """What a reader reads through a relay; None if it takes the relay."""
    if len(node.edges) > 1 and (reader.product or not edge.map.same):
        return None
    found = []
    for inner in node.edges:
        source, map = nodes[inner.source], chain(inner.map, edge.map)
        lags = late(source, node) + late(node, reader)
        kept = source.role in SOURCES or lags == late(source, reader)
        if map is None or not kept:
            return None
        found.append(Edge(inner.source, map))
    return found


def synchronous(nodes: Nodes) -> bool:
    """Whether all that fields and traces read of each other is that of the step before."""
    lags: dict[str, set[int] | None] = {}

    def through(node: Node) -> set[int]:
        read = [(of(edge.source), late(nodes[edge.source], node)) for edge in node.edges]
        return {lag + own for each, own in read for lag in each}

    def of(label: str) -> set[int]:
        node = nodes[label]
        if node.role in MEMBERS:
            return {0}
        if label not in lags:
            lags[label] = None  # on the way: who meets it here goes in a circle
            lags[label] = {
                lag + late(nodes[edge.source], node)
                for edge in node.edges
                for lag in of(edge.source)
            }
        found = lags[label]
        return {2} if found is None else found

    try:
        return all(through(node) <= {1} for node in nodes.values() if node.role in MEMBERS)
    except RecursionError:  # a chain of a thousand elements: the order of the file is always right
        return False


def taken(node: Node) -> tuple[tuple, tuple[str, ...]]:
    """What a field reads of itself, as a kernel with its borders; taken from its edges."""
    own, rest = [], []
    for edge in node.edges:
        lateral = edge.source == node.label and _is_kernel(edge.map)
        (own if lateral else rest).append(edge)
    node.edges = rest
    borders = {edge.map.border for edge in own if _bounded(edge.map)}
    terms: tuple = ()
    for edge in own:
        map = edge.map
        if not map.terms:
            whole = not map.came or not map.through
            terms += (Global(map.gain),) if whole else (Gauss(map.gain, 0.0),)
        elif len(borders) > 1 and _bounded(map):
            terms += tuple(_matrices(term, node.shape, map.border) for term in amplified(map))
        else:
            terms += amplified(map)
    return terms, borders.pop() if len(borders) == 1 else ("circular",) * len(node.shape)


def _is_kernel(map: Map) -> bool:
    """Whether a map is a kernel over all axes, or a sum over all that reaches all."""
    return map.came == map.goes or (not map.through and not map.terms)


def _bounded(map: Map) -> bool:
    return any(isinstance(term, Gauss) for term in map.terms)


def amplified(map: Map) -> tuple:
    """The terms of a map, times its gain."""
    return tuple(
        Matrices((map.gain * term.matrices[0], *term.matrices[1:]))
        if isinstance(term, Matrices)
        else term._replace(amplitude=map.gain * term.amplitude)
        for term in map.terms
    )


def _matrices(term, shape: tuple[int, ...], border: tuple[str, ...]):
    """A Gaussian as matrices, which have a border of their own."""
    if not isinstance(term, Gauss):
        return term
    each = [
        gauss_matrix(n, s, edge, 0.0, term.cutoff, term.normalized)
        for n, s, edge in zip(shape, per_axis("sigma", term.sigma, len(shape)), border)
    ]
    return Matrices((term.amplitude * each[0], *each[1:]))

"""Architectures of fields: any number of them, coupled by links."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor, nn

from dntorch.cells.kernels import Kernel, sites
from dntorch.checks import check_ends, check_entries, check_named, shown
from dntorch.dynamics import Dynamics
from dntorch.modules.elements import (
    Arm,
    Element,
    Elements,
    Field,
    Member,
    Passing,
    Stimulus,
    check_stimulus,
)
from dntorch.modules.field import DNF
from dntorch.modules.projection import Projection
from dntorch.modules.relay import Relay
from dntorch.modules.wiring import backward, escaped, in_order

if TYPE_CHECKING:
    from dntorch.modules.folding import Folded


class Link(NamedTuple):
    """What one element of an architecture gives to another; see `Projection` for the last four.

    ``Link("a", "b", kernel=2.0)``, or the plain tuple ``("a", "b", 2.0)``.
    """

    source: str
    target: str
    axes: Any = None
    """A pattern; None for the same axes; or a `Projection`, which says all."""
    kernel: float | Tensor | Kernel = 1.0
    border: str | Sequence[str] = "circular"
    reduce: str = "sum"


class Coupling(NamedTuple):
    """A link as it was built."""

    source: str
    target: str
    projection: Projection
    """Its ``kernel`` can be set."""


class Architecture(Dynamics[dict[str, Tensor]]):
    r"""Fields, nodes and memory traces by name, coupled by projections.

    .. math:: \tau_i \dot u_i = -u_i + h_i + \omega_i * f(u_i) + S_i + \sum_{j \to i} P_{ij} f(u_j)

    >>> from dntorch import DNF, Gauss, gauss
    >>> model = Architecture(
    ...     {"scene": DNF((4, 50), ()), "space": DNF(50)},
    ...     ("scene", "space", "c p -> p", Gauss(6.0, 2.0)),
    ...     ("space", "scene", "p -> c p", 1.0),
    ... )
    >>> cue = gauss((4, 50), (1, 20), (0.5, 2.0), 9.0)
    >>> for _ in range(32):
    ...     outputs = model({"scene": cue})
    >>> int(model.state["space"].argmax())
    20

    Args:
        elements: by name, in any letters: structures with a state of one tensor (`DNF`,
            `NodeWTA`, `MemoryTrace`), and `Relay` s, which have none. All with the same ``dt``.
        links: `Link` s, or plain tuples ``(source, target, axes, kernel, border, reduce)`` of which
            the last may be left out; ``(source, target, kernel)`` for the same axes. In any order.
        inputs: more sources for links, by name: a tensor is a stimulus that acts by itself, a
            shape one that is silent unless it is given.
        order: names of all elements. Without it all read what the others show at time t, and then
            all move. With it they step one after the other, in this order, as in COSIVINA: what
            stands before shows its new output, what stands behind that of the step before. A relay
            that stands behind one that reads it is then an entry of the state, at rest what it
            shows of the others at rest.
        filled: False: those entries are 0 at rest, as in the first step of COSIVINA.

    Shapes: ``inputs``: tensors by name, ``(*batch, *shape)`` each; what is given to an element is
    added to what its links give. What is left out is 0. Outputs by name of all elements that are no
    relay, after the step. State: a tensor by name, such as ``u`` of a field.

    ``architecture["scene"]`` is the element, whose parameters may be set; that of an input has its
    constant, ``value``. ``links`` lists ``(source, target, projection)``, whose kernels may be set:
    ``architecture.links[0].projection.kernel = 2.0``. A `MemoryTrace` among the elements is
    long-term memory, as it is alone: with one, take ``spread(*batch)`` for ``resize(*batch)``.
    ``fold()`` makes one matrix of all that is linear. ``docs/fields.md`` has examples.

    Raises:
        ValueError: a link to what is not there, a pattern or kernel that does not fit, relays in a
            circle, an element with a state of several tensors, elements of different ``dt``; in a
            step, an input that is no element or doesn't end in its shape.

    Not in the paper.
    """

    __jit_unused_properties__ = ("links",)
    fixed = ("dt", "filled")
    _shapes: dict[str, list[int]]
    _carried: list[str]
    _entries: list[str]

    def __init__(
        self,
        elements: Mapping[str, Dynamics | Relay],
        *links: Link | tuple,
        inputs: Mapping[str, Tensor | int | Sequence[int]] | None = None,
        order: Sequence[str] | None = None,
        filled: bool = True,
    ) -> None:
        parts = _checked(elements)
        members = [part for part in parts.values() if isinstance(part, Dynamics)]
        super().__init__(members[0].dt)
        self.to(members[0].origin.dtype)
        if not isinstance(filled, bool):
            raise TypeError(f"filled={shown(filled)}: give True or False")
        stimuli = _stimuli(inputs, self.origin)
        for label in stimuli.keys() & parts.keys():
            raise ValueError(f"inputs has {label!r}, which is an element, too: give another name")
        self._shapes = {label: list(x.shape) for label, x in stimuli.items()}
        self._shapes |= {label: _shape_of(part) for label, part in parts.items()}
        arms: dict[str, list[Arm]] = {label: [] for label in parts}
        for link in map(_as_link, links):
            arms[self._target(link, arms)].append(Arm(link.source, self._projection(link)))
        for each in arms.values():  # sums in one order, in whatever order the links were given
            each.sort(key=lambda arm: (arm.source, arm.projection.axes))
        reads = {label: [arm.source for arm in each] for label, each in arms.items()}
        relays = [label for label, part in parts.items() if isinstance(part, Relay)]
        self.ordered, self.filled = order is not None, filled
        sequence = in_order(reads, relays, order)
        behind = backward(reads, relays, sequence) if self.ordered else {}
        self._carried = list(behind)
        self._passes = (1 + max(behind.values(), default=0)) if self.ordered and filled else 0
        self.stimuli = nn.ModuleDict({escaped(k): Stimulus(k, x) for k, x in stimuli.items()})
        self.elements = Elements(sequence)
        for label in sequence:
            part = parts[label]
            if isinstance(part, Relay):
                element: Element = Passing(label, part, arms[label], label in behind)
            else:
                kind = Field if type(part) is DNF else Member  # no subclass with a step of its own
                element = kind(label, part, _entry_of(label, part), arms[label])
            self.elements[escaped(label)] = element
        self._entries = [x.label for x in self.elements.values() if x.kept]
        self.to(self.origin.dtype)

    # ------------------------------------------------------------- links

    def _target(self, link: Link, targets: Mapping[str, Any]) -> str:
        for role, label, known in (
            ("source", link.source, self._shapes),
            ("target", link.target, targets),
        ):
            if not isinstance(label, str) or label not in known:
                raise ValueError(
                    f"link {_told(link)}: {role} {label!r} is not there: choose from {list(known)}"
                )
        return link.target

    def _projection(self, link: Link) -> Projection:
        source, target = self._shapes[link.source], self._shapes[link.target]
        projection = link.axes
        try:
            if projection is None:
                if source != target and isinstance(link.kernel, (int, float, Tensor)):
                    raise ValueError(
                        f"shapes {source} and {target} differ: name the axes, such as 'y x -> x'"
                    )
                names = " ".join(f"a{k}" for k in range(len(target)))
                projection = f"{names} -> {names}"
            if isinstance(projection, str):
                how = {"border": link.border, "reduce": link.reduce, "dtype": self.origin.dtype}
                projection = Projection(projection, source, target, link.kernel, **how)
            if not isinstance(projection, Projection):
                raise TypeError(
                    f"axes={shown(projection)} is no pattern: give one such as 'y x -> x'"
                )
        except (ValueError, TypeError) as error:
            raise type(error)(f"link {_told(link)}: {error}") from error
        if [projection.source, projection.target] != [source, target]:
            raise ValueError(
                f"link {_told(link)}: the projection leads from {projection.source} to "
                f"{projection.target}, the elements have {source} and {target}: build one for them"
            )
        return projection

    @property
    def links(self) -> list[Coupling]:
        """All links as they were built, in the order in which targets step."""
        return [
            Coupling(arm.source, element.label, arm.projection)
            for element in self.elements.values()
            for arm in element.arms
        ]

    def __getitem__(self, label: str) -> Any:
        if label not in self:
            raise KeyError(f"{shown(label)} is not there: choose from {list(self._shapes)}")
        key = escaped(label)
        if key in self.stimuli:
            return self.stimuli[key]
        element = self.elements[key]
        return element.relay if isinstance(element, Passing) else element.part

    def __contains__(self, label: object) -> bool:
        return isinstance(label, str) and label in self._shapes

    def labels(self) -> Iterator[str]:
        """Names of all elements and inputs."""
        return iter(self._shapes)

    def fold(self) -> "Folded":
        """The same with one matrix for all couplings, several times as fast; see `Folded`.

        Raises:
            ValueError: names what cannot be folded: products, maxima, an order, sub-steps, traces,
                nodes, and more sites than a matrix should have.
        """
        from dntorch.modules.folding import Folded  # which is built on this file

        return Folded(self)

    # ------------------------------------------------------------- state

    @property
    def state(self) -> dict[str, Tensor]:
        state: dict[str, Tensor] = {}
        for element in self.elements.values():
            if element.kept:
                state[element.label] = element.held()
        return state

    @state.setter
    def state(self, state: dict[str, Tensor]) -> None:
        if not torch.jit.is_scripting():
            self._require_state(state)
        self.write(state)

    def write(self, state: dict[str, Tensor]) -> None:
        for element in self.elements.values():
            if element.kept:
                element.write(state[element.label])

    def flat(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        flat: dict[str, Tensor] = {}
        for element in self.elements.values():
            if element.kept:
                flat[element.path] = state[element.label]
        return flat

    @torch.jit.unused
    def _named(self, state: Any) -> dict[str, Tensor]:
        return dict(state)

    def nested(self, flat: dict[str, Tensor]) -> dict[str, Tensor]:
        state: dict[str, Tensor] = {}
        for element in self.elements.values():
            if element.kept:
                state[element.label] = flat[element.path]
        return state

    def initial(self, batch: list[int]) -> dict[str, Tensor]:
        rest: dict[str, Tensor] = {}
        for element in self.elements.values():
            if element.kept:
                rest[element.label] = element.rest(batch)
        if self._passes > 0:
            none: dict[str, Tensor] = {}
            shown = self._shown(none, rest)
            for _ in range(self._passes):
                shown = self._passed(shown, batch)
            for label in rest.keys():
                if label in self._carried:
                    rest[label] = shown[label]
        return rest

    def _passed(self, shown: dict[str, Tensor], batch: list[int]) -> dict[str, Tensor]:
        """What all show when each relay has passed on once, in order."""
        none: dict[str, Tensor] = {}
        for element in self.elements.values():
            if element.passing:
                reaching = element.gather(shown, none)
                shown[element.label] = element.advance(reaching, reaching, element.rest(batch))
        return shown

    @torch.jit.export
    def reset(self) -> None:
        rest = self.initial(list(self.origin.shape))
        for element in self.elements.values():
            if element.kept:
                element.reset(rest[element.label])

    @torch.jit.export
    def forget(self) -> None:
        for element in self.elements.values():
            element.forget()

    @torch.jit.unused
    def resize(self, *batch: int) -> "Architecture":
        super().resize(*batch)
        with torch.inference_mode(False):
            rest = self.initial(list(batch))
            for element in self.elements.values():
                if element.passing and element.kept:
                    element.register_buffer("shown", rest[element.label], persistent=False)
        return self

    # ------------------------------------------------------------- steps

    def _shown(self, given: dict[str, Tensor], state: dict[str, Tensor]) -> dict[str, Tensor]:
        """What all show at time t."""
        shown: dict[str, Tensor] = {}
        for stimulus in self.stimuli.values():
            shown[stimulus.label] = stimulus.shows(given)
        for element in self.elements.values():
            if element.kept:
                shown[element.label] = element.shows(state[element.label])
            else:
                shown[element.label] = element.nothing
        return shown

    def step(
        self, inputs: dict[str, Tensor], state: dict[str, Tensor]
    ) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        if not torch.jit.is_scripting():
            check_named("inputs", inputs)
            check_entries(state, self._entries, self._shapes)
        for label, given in inputs.items():
            if label not in self._shapes:
                raise ValueError(
                    f"inputs has '{label}', which is no element: choose from "
                    f"{list(self._shapes.keys())}"
                )
            check_ends(label, given, self._shapes[label])
        shown = self._shown(inputs, state)
        outputs: dict[str, Tensor] = {}
        ahead: dict[str, Tensor] = {}
        for element in self.elements.values():
            held = state[element.label] if element.kept else self.origin
            x = element.advance(element.gather(shown, inputs), shown[element.label], held)
            now = element.shows(x)
            if element.kept:
                ahead[element.label] = x
            if element.passing or self.ordered:
                shown[element.label] = now
            if not element.passing:
                outputs[element.label] = now
        return outputs, ahead


def _checked(elements: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(elements, Mapping):
        raise TypeError(f"elements={shown(elements)} is no mapping: give names and structures")
    for label, part in elements.items():
        if not isinstance(label, str) or not label:
            raise ValueError(f"elements has the name {shown(label)}: give text")
        if not isinstance(part, (Dynamics, Relay)):
            raise TypeError(
                f"elements[{label!r}] is a {type(part).__name__}: give a DNF, NodeWTA, MemoryTrace "
                "or Relay"
            )
    members = {label: part for label, part in elements.items() if isinstance(part, Dynamics)}
    if not members:
        raise ValueError(f"elements={list(elements)}: give at least one with a state, such as DNF")
    first = next(iter(members))
    for label, part in members.items():  # of which a composite would round all but one
        own, dtype = part.origin.dtype, members[first].origin.dtype
        if own != dtype:
            raise ValueError(
                f"elements[{label!r}] of dtype {own} does not fit the {dtype} of {first!r}: build "
                "all with one dtype"
            )
    return dict(elements)


def _entry_of(label: str, part: Dynamics) -> str:
    """The name of the one tensor of its state."""
    names = list(part.flat(part.state))
    takes = list(part._arguments) and hasattr(part, "euler") and hasattr(part, "output")
    if len(names) != 1 or not takes:
        raise ValueError(
            f"elements[{label!r}], a {type(part).__name__}, has a state of {len(names)} tensors: "
            "give a structure whose state is one, with euler and output"
        )
    return names[0]


def _shape_of(part: Any) -> list[int]:
    if isinstance(part, Relay):
        return part.shape
    rest = part.flat(part.state)
    return list(next(iter(rest.values())).shape[part.origin.dim() :]) if rest else []


def _stimuli(inputs: Any, like: Tensor) -> dict[str, Tensor]:
    """Constants by name, in one dtype."""
    if inputs is None:
        return {}
    check_named("inputs", inputs)
    values = {}
    for label, given in inputs.items():
        if not isinstance(label, str) or not label:
            raise ValueError(f"inputs has the name {shown(label)}: give text")
        name = f"inputs[{label!r}]"
        if isinstance(given, Tensor):
            check_stimulus(name, given)
            values[label] = given.detach().to(like, copy=True)
        else:
            values[label] = torch.zeros(sites(given, name))
    return values


def _as_link(link: Any) -> Link:
    if isinstance(link, Link):
        return link
    if not isinstance(link, tuple) or not 2 <= len(link) <= len(Link._fields):
        raise ValueError(f"link {shown(link)}: give (source, target, axes, kernel, border, reduce)")
    if len(link) == 3 and not isinstance(link[2], (str, Projection, type(None))):
        return Link(link[0], link[1], None, link[2])
    return Link(*link)


def _told(link: Link) -> str:
    return f"({shown(link.source)}, {shown(link.target)})"

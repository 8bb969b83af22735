"""One matrix for all that is linear between the fields of an architecture."""

import math
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import linear

from dntorch.cells.field import lateral
from dntorch.cells.functions import sigmoid
from dntorch.checks import check_ends, check_entries, check_named
from dntorch.dynamics import Dynamics
from dntorch.modules.architecture import Architecture
from dntorch.modules.elements import Member
from dntorch.modules.field import DNF
from dntorch.modules.relay import Relay
from dntorch.plumbing import overwrite

LARGEST = 4096**2
"""Entries of a matrix from which on it costs more than the couplings that it stands for."""


class Folded(Dynamics[dict[str, Tensor]]):
    r"""An architecture of fields whose couplings are one matrix; steps as `Architecture` does.

    .. math:: \tau \dot u = -u + h + S + W f(u)

    over the sites of all fields, one after the other; :math:`W` is the sum over all paths from a
    field to a field, kernels of the fields included.

    Inputs, outputs and state by name are those of the architecture, equal to it up to rounding.
    What was folded is fixed: set parameters in the architecture and fold again.

    >>> from dntorch import DNF, Gauss, gauss
    >>> links = ("a", "b", Gauss(6.0, 2.0)), ("b", "a", "x -> x", -1.0)
    >>> model = Architecture({"a": DNF(50), "b": DNF(50, h=-3.0)}, *links)
    >>> folded, cue = model.fold(), gauss(50, 20, 3.0, 8.0)
    >>> for _ in range(32):
    ...     outputs, same = model({"a": cue}), folded({"a": cue})
    >>> bool((outputs["b"] - same["b"]).abs().max() < 1e-4)
    True

    Raises:
        ValueError: what cannot be folded, with names and why; as for `Architecture` in a step.
    """

    u: Tensor
    matrix: Tensor
    constant: Tensor
    rest: Tensor
    rate: Tensor
    steepness: Tensor
    threshold: Tensor
    forcing: Tensor
    _shapes: dict[str, list[int]]
    _all: list[list[int]]
    _labels: list[str]
    _forced: list[str]
    _sizes: list[int]
    _first: list[int]

    def __init__(self, whole: Architecture) -> None:
        refuse_what_cannot_be_folded(whole)
        super().__init__(whole.dt)
        members = [x for x in whole.elements.values() if isinstance(x, Member)]
        parts = [member.part for member in members]
        self._shapes = dict(whole._shapes)
        self._labels = [member.label for member in members]
        self._forced = [label for label in whole._shapes if label not in self._labels]
        self._all, self.kind = [member.shape for member in members], parts[0].kind
        self._sizes = [math.prod(shape) for shape in self._all]
        widths = [math.prod(self._shapes[label]) for label in self._forced]
        self._first = [sum(widths[:k]) for k in range(len(widths))]
        self.to(parts[0].origin.dtype)

        def over(numbers: list[float]) -> Tensor:
            return torch.cat(
                [self.origin.new_full([n], float(x)) for n, x in zip(self._sizes, numbers)]
            )

        with torch.no_grad():
            none = dict[str, Tensor]()
            silent = {label: self.origin.new_zeros(shape) for label, shape in self._shapes.items()}
            acting = {x.label: x.shows(none) for x in whole.stimuli.values()}
            levels = over([part.h for part in parts])
            each = {
                "matrix": torch.cat([_column(whole, silent, x) for x in self._labels], -1),
                "constant": _reaching(whole, silent | acting, none) + levels,
                "rest": levels,
                "rate": over([part.dt / part.tau for part in parts]),
                "steepness": over([part.steepness for part in parts]),
                "threshold": over([part.threshold for part in parts]),
                "forcing": torch.cat(
                    [levels.new_zeros(len(levels), 0)]
                    + [_column(whole, silent, x) for x in self._forced],
                    -1,
                ),
            }
        for name, tensor in each.items():
            self.register_buffer(name, tensor.to(self.origin), persistent=False)
        self.register_buffer("u", self.rest.clone(), persistent=False)

    # ------------------------------------------------------------- state

    def _apart(self, flat: Tensor) -> dict[str, Tensor]:
        """The sites of each field, from those of all."""
        named: dict[str, Tensor] = {}
        batch = list(flat.shape[: flat.dim() - 1])
        for k, own in enumerate(flat.split(self._sizes, -1)):
            named[self._labels[k]] = own.reshape(batch + self._all[k])
        return named

    def _together(self, named: dict[str, Tensor]) -> Tensor:
        rows: list[Tensor] = []
        for k, label in enumerate(self._labels):
            rows.append(_flat(named[label], len(self._all[k])))
        return torch.cat(rows, -1)

    @property
    def state(self) -> dict[str, Tensor]:
        return self._apart(self.u.clone())

    @state.setter
    def state(self, state: dict[str, Tensor]) -> None:
        if not torch.jit.is_scripting():
            self._require_state(state)
        self.write(state)

    def write(self, state: dict[str, Tensor]) -> None:
        overwrite(self.u, self._together(state))

    def flat(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        return {"u": self._together(state)}

    @torch.jit.unused
    def _named(self, state: Any) -> dict[str, Tensor]:
        return dict(state)

    def nested(self, flat: dict[str, Tensor]) -> dict[str, Tensor]:
        return self._apart(flat["u"])

    def initial(self, batch: list[int]) -> dict[str, Tensor]:
        return self._apart(self.rest.expand(batch + [self.rest.shape[0]]).clone())

    @torch.jit.export
    def reset(self) -> None:
        self.write(self.initial(list(self.origin.shape)))

    @torch.jit.unused
    def resize(self, *batch: int) -> "Folded":
        super().resize(*batch)
        with torch.inference_mode(False):
            start = self._together(self.initial(list(batch)))
            self.register_buffer("u", start, persistent=False)
        return self

    # ------------------------------------------------------------- steps

    def step(
        self, inputs: dict[str, Tensor], state: dict[str, Tensor]
    ) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        if not torch.jit.is_scripting():
            check_named("inputs", inputs)
            check_entries(state, self._labels, self._shapes)
        for label, given in inputs.items():
            if label not in self._shapes:
                raise ValueError(
                    f"inputs has '{label}', which is no element: choose from "
                    f"{list(self._shapes.keys())}"
                )
            check_ends(label, given, self._shapes[label])
        u = self._together(state)
        target = linear(self._output(u), self.matrix, self.constant)
        if len(inputs) > 0:
            target = target + self._drive(inputs)
        ahead = u.lerp(target, self.rate)
        return self._apart(self._output(ahead)), self._apart(ahead)

    def _output(self, u: Tensor) -> Tensor:
        """`sigmoid` with a steepness and a threshold per site, of which it takes one for all."""
        if self.kind == "logistic":
            return torch.sigmoid(self.steepness * (u - self.threshold))
        if self.kind == "semilinear":
            return torch.relu(self.steepness * (u - self.threshold))
        if self.kind == "heaviside":
            return sigmoid(u - self.threshold, self.kind, 1.0, 0.0)
        return sigmoid(self.steepness * (u - self.threshold), self.kind, 1.0, 0.0)

    def _drive(self, inputs: dict[str, Tensor]) -> Tensor:
        """What is given by hand, as it reaches the sites of all fields."""
        rows: list[Tensor] = []
        for k, label in enumerate(self._labels):
            given = inputs[label] if label in inputs else self.rest.new_zeros(self._all[k])
            rows.append(_flat(given, len(self._all[k])))
        drive = _joined(rows)
        for k, label in enumerate(self._forced):
            if label in inputs:
                given = _flat(inputs[label], len(self._shapes[label]))
                columns = self.forcing.narrow(1, self._first[k], given.shape[-1])
                drive = drive + linear(given, columns)
        return drive


def _flat(x: Tensor, axes: int) -> Tensor:
    """The sites of a field of so many axes as one."""
    return x.flatten(-axes) if axes > 0 else x.unsqueeze(-1)


def _joined(rows: list[Tensor]) -> Tensor:
    """One row of all, in the largest of their batches."""
    batch = list(rows[0].shape[:-1])
    for row in rows:
        if row.dim() > len(batch) + 1:
            batch = list(row.shape[:-1])
    return torch.cat([row.expand(batch + [row.shape[-1]]) for row in rows], -1)


def refuse_what_cannot_be_folded(whole: Architecture) -> None:
    """Raise a ``ValueError`` that names each element and link that one matrix cannot stand for."""
    left: list[str] = []
    if whole.ordered:
        left.append("order: its elements step one after the other")
    kinds = [x.part.kind for x in whole.elements.values() if isinstance(getattr(x, "part", 0), DNF)]
    sites = 0
    for element in whole.elements.values():
        if element.product:
            left.append(f"{element.label!r} multiplies")
        for arm in element.arms:
            if arm.projection.reduce in ("max", "min") and arm.projection.reduces:
                left.append(f"({arm.source!r}, {element.label!r}) takes a {arm.projection.reduce}")
        if not isinstance(element, Member):
            if element.relay.kind != "linear":
                left.append(f"{element.label!r} has the output function {element.relay.kind!r}")
            continue
        if not isinstance(element.part, DNF):
            left.append(f"{element.label!r} is a {type(element.part).__name__}")
            continue
        sites += math.prod(element.shape)
        if element.part.substeps > 1:
            left.append(f"{element.label!r} has sub-steps")
        if element.part.kind != kinds[0]:
            left.append(f"{element.label!r} is {element.part.kind!r}, others are {kinds[0]!r}")
        if any(isinstance(x, Tensor) and x.dim() for x in (element.part.tau, element.part.h)):
            left.append(f"{element.label!r} has numbers per agent")
    if sites**2 > LARGEST:
        most = math.isqrt(LARGEST)
        left.append(f"{sites} sites are too many for a matrix, which may have {most}")
    if left:
        raise ValueError(f"fold() cannot fold this: {'; '.join(left)}; step it as it is")


def _reaching(whole: Architecture, shown: dict[str, Tensor], given: dict[str, Tensor]) -> Tensor:
    """What reaches the sites of all fields, ``(*batch, sites)``, by links and kernels."""
    shown, rows = dict(shown), []
    for element in whole.elements.values():
        reaching = element.gather(shown, given)
        if not isinstance(element, Member):
            shown[element.label] = reaching
            continue
        part = element.part
        own = lateral(shown[element.label], part._stacks(), part.everywhere)
        rows.append(_flat(reaching + own, len(element.shape)))
    return _joined(rows)


def _column(whole: Architecture, silent: dict[str, Tensor], label: str) -> Tensor:
    """What each site of one element gives to the sites of all fields, ``(to, from)``."""
    shape = whole._shapes[label]
    each = torch.eye(math.prod(shape), dtype=whole.origin.dtype).reshape([-1, *shape])
    relay = isinstance(whole[label], Relay)
    shown, given = (silent, {label: each}) if relay else (silent | {label: each}, {})
    return _reaching(whole, shown, given).expand(len(each), -1).t()  # an input may reach nothing

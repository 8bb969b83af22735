"""The golden record: what the eager structure did, for others to be compared with."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.export.boundary import Boundary, Input, Port
from dntorch.noise import keyed_uniform

EVERY = 50
"""Steps between two snapshots of the state."""
PROBES = 16
"""Steps from random states, in which every constant of a structure takes part."""
SMALL = 64
"""State tensors of up to so many numbers are recorded in every step."""


class Taken(NamedTuple):
    """A step that was taken, for who closes the loop."""

    outputs: list[Tensor]
    before: dict[str, Tensor]
    """the state, by name"""
    after: dict[str, Tensor]


@dataclass
class Golden:
    """The state at the start, one continuous run, single steps from given states ("pairs")."""

    start: dict[str, list[np.ndarray]] = field(default_factory=dict)
    run: dict[str, list[np.ndarray]] = field(default_factory=dict)
    pairs: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def arrays(self) -> dict[str, np.ndarray]:
        sections = {"start": self.start, "run": self.run, "pairs": self.pairs}
        return {f"{s}/{k}": np.stack(v) for s, part in sections.items() for k, v in part.items()}


Feed = Callable[[int, Taken | None], tuple[Sequence[Input], Mapping[str, Tensor]]]


@torch.inference_mode()
def record(
    boundary: Boundary,
    feed: Feed,
    steps: int,
    notable: Callable[[Taken], bool] = lambda taken: False,
) -> Golden:
    """Run the eager structure.

    Args:
        feed: ``feed(step, the step taken before it)`` gives inputs and switches.
        notable: after which steps a snapshot is kept besides those every `EVERY` steps.
    """
    golden, taken = Golden(), None
    state = boundary.structure.flat(boundary.structure.state)
    kept = _switches(boundary)
    _extend(golden.start, "", state)
    switches = dict(kept)
    for step in range(steps):
        inputs, changed = feed(step, taken)
        switches.update(changed)
        taken = _step(boundary, inputs, switches, state)
        _append(golden.run, boundary, inputs, switches, taken.outputs)
        small = {k: v for k, v in taken.after.items() if v.numel() <= SMALL}
        _extend(golden.run, "next.", small)
        if step % EVERY == 0 or notable(taken):
            _pair(golden, boundary, step, inputs, switches, taken)
        state = taken.after
    for probe in range(PROBES):
        inputs = boundary.arguments(
            {port.name: _random(port, probe, k) for k, port in enumerate(boundary.inputs)}
        )
        wild = {
            port.name: _random(port, probe, 100 + k, signed=True)
            for k, port in enumerate(boundary.state)
        }
        taken = _step(boundary, inputs, switches, wild)
        _pair(golden, boundary, -1, inputs, switches, taken)
    _set(boundary, kept)
    return golden


def _step(boundary: Boundary, inputs, switches, state) -> Taken:
    _set(boundary, switches)
    structure = boundary.structure
    output, ahead = structure.step(*inputs, structure.nested(state))
    return Taken(pytree.tree_leaves(output), state, structure.flat(ahead))


def _switches(boundary: Boundary) -> dict[str, Tensor]:
    return {p.name: boundary.structure.get_buffer(p.name).clone() for p in boundary.switches}


def _set(boundary: Boundary, switches: Mapping[str, Tensor]) -> None:
    for name, value in switches.items():
        boundary.structure.get_buffer(name).copy_(value)


def _pair(golden: Golden, boundary: Boundary, step: int, inputs, switches, taken) -> None:
    golden.pairs.setdefault("step", []).append(np.array(step))
    _append(golden.pairs, boundary, inputs, switches, taken.outputs)
    _extend(golden.pairs, "state.", taken.before)
    _extend(golden.pairs, "next.", taken.after)


def _append(part: dict, boundary: Boundary, inputs, switches, outputs) -> None:
    _extend(part, "", boundary.named(inputs))
    _extend(part, "", switches)
    _extend(part, "", {port.name: x for port, x in zip(boundary.outputs, outputs, strict=True)})


def _extend(part: dict[str, list[Any]], prefix: str, tensors: Mapping[str, Tensor]) -> None:
    for name, tensor in tensors.items():
        part.setdefault(prefix + name, []).append(tensor.detach().cpu().numpy().copy())


def _random(port: Port, probe: int, stream: int, signed: bool = False) -> Tensor:
    """Numbers of a port that make its structure work, the same on every machine."""
    count = int(np.prod(port.shape))
    draw = keyed_uniform(0, torch.tensor(0), torch.tensor(probe), count, stream)
    draw = draw.reshape(port.shape)
    if port.dtype == torch.uint8:
        # Few grays: strong colours or black.
        return (256 * draw).floor().sub(128).abs().mul(2).clamp(0, 255).to(torch.uint8)
    if not port.dtype.is_floating_point:
        return (100 * draw).to(port.dtype)
    return ((4 * draw - 2) if signed else draw).to(port.dtype)

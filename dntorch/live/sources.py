"""What may be watched: a structure of this library, a COSIVINA file, a run with its world."""

import copy
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch

from dntorch.dynamics import Dynamics
from dntorch.live.knobs import Knob, architecture_knobs, part_knobs
from dntorch.live.watched import KINDS, Watched, watch
from dntorch.modules.architecture import Architecture


class Source:
    """A structure that is stepped, with what it is stepped in; the structure is a copy.

    Attributes:
        title: for people.
        structure: what is stepped.
        dt: seconds per step.
        parts: what can be seen of it, by name.
        shown: names that are shown at first.
        knobs: what can be turned.
        letters: of the sites of a part or a matrix, by its title, where they have some.
        rewarded: whether there is somebody who learns from a reward.
    """

    title: str
    structure: Dynamics
    dt: float
    parts: dict[str, Watched]
    shown: list[str]
    knobs: list[Knob]
    letters: Mapping[str, str] = MappingProxyType({})
    rewarded = False

    def advance(self) -> None:
        """One step of ``dt`` seconds."""
        raise NotImplementedError

    def reset(self) -> None:
        """Back to rest; what was learned stays."""
        raise NotImplementedError

    def images(self) -> dict[str, np.ndarray]:
        """Pictures besides the fields, RGB, uint8, by title."""
        return {}

    def matrices(self) -> dict[str, np.ndarray]:
        """Numbers besides the fields, by title, ``(rows, columns)``."""
        return {}

    def note(self) -> str:
        """One line about what happened."""
        return ""

    def reward(self) -> None:
        """Give the reward by hand."""
        raise ValueError("nobody learns from a reward here: give the folder of a run")

    def learn(self, on: bool) -> None:
        """Switch learning on or off."""
        raise ValueError("nobody learns from a reward here: give the folder of a run")

    def close(self) -> None:
        """Give back what is held outside."""


class StructureSource(Source):
    """An `Architecture`, a `DNF`, a `NodeWTA` or a `MemoryTrace`, without other inputs.

    Args:
        structure: is copied.
        title: for people.
        noise: inputs of an architecture that are drawn anew in each step, with sd 1, by label.

    Raises:
        TypeError: another structure.
        ValueError: a structure with a batch.
    """

    def __init__(
        self, structure: Dynamics, title: str = "", noise: Mapping[str, Sequence[int]] | None = None
    ) -> None:
        if not isinstance(structure, (Architecture, *KINDS)):
            raise TypeError(
                f"{type(structure).__name__} cannot be viewed: give an Architecture, a DNF, a "
                "NodeWTA, a MemoryTrace, or the path of a COSIVINA file or a run"
            )
        if structure.origin.dim():
            raise ValueError(
                f"the structure has a batch {list(structure.origin.shape)}: view one of it, "
                "structure.select(0)"
            )
        self.structure, self.dt = copy.deepcopy(structure), structure.dt
        self.title = title or type(structure).__name__
        self.parts = watch(self.structure)
        fields = [k for k, part in self.parts.items() if not part.relay]
        wide = [k for k in fields if math.prod(self.parts[k].shape) > 1]
        self.shown = (wide or fields)[:3]
        self._noise, self._gain, self._generator = dict(noise or {}), 1.0, torch.Generator()
        if isinstance(structure, Architecture):
            self.knobs = list(architecture_knobs(self.structure))
            if self._noise:
                self.knobs.append(
                    Knob("noise", "gain", 0.0, 3.0, lambda: self._gain, self._set_gain)
                )
        else:
            (label,) = fields
            self.knobs = list(part_knobs(label, self.structure))
            self._silence = torch.zeros(self.parts[label].shape).to(self.structure.origin)

    def _set_gain(self, gain: float) -> None:
        self._gain = gain

    def advance(self) -> None:
        if not isinstance(self.structure, Architecture):
            self.structure(self._silence)
            return
        like, drawn = self.structure.origin, {}
        if self._gain:
            for label, shape in self._noise.items():
                white = torch.randn(tuple(shape), generator=self._generator)
                drawn[label] = self._gain * white.to(like)
        self.structure(drawn)

    def reset(self) -> None:
        self.structure.reset()
        for part in self.parts.values():
            part.input = torch.zeros_like(part.input)


def open_source(target: Any) -> Source:
    """What there is to watch behind a structure, or the path of a COSIVINA file or a run.

    Raises:
        ValueError: a path at which there is neither.
        TypeError: something else.
    """
    if isinstance(target, Source):
        return target
    if isinstance(target, Dynamics):
        return StructureSource(target)
    if not isinstance(target, (str, Path)):
        raise TypeError(
            f"target={target!r} cannot be viewed: give an Architecture, a DNF, or the path of a "
            "COSIVINA file or a run"
        )
    path = Path(target)
    if not path.exists():
        raise ValueError(f"{path} is not there: name a COSIVINA file or the folder of a run")
    if path.is_dir() or path.suffix == ".pt":
        from dntorch.live.run_source import RunSource

        return RunSource(path)
    from dntorch import cosivina

    return StructureSource(cosivina.load(path), str(path), cosivina.noise(path))

"""What may be watched: a structure of this library, a COSIVINA file, a run with its world."""

import copy
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dntorch.dynamics import Dynamics
from dntorch.live.knobs import Knob, architecture_knobs, part_knobs
from dntorch.live.watched import KINDS, Watched, watch
from dntorch.modules.architecture import Architecture

OUTSIDE = 0.25
"""Seconds between two views from outside."""
MATRICES = ("values (state by action)", "eligibility trace (state by action)")


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


class RunSource(Source):
    """The agent of a run in a fresh world; the run's files are only read.

    It learns on. Explores only as far as "exploration" is turned up, but one without phases
    explores as it did.

    Args:
        path: folder of the run, or its checkpoint.

    Raises:
        ValueError: no checkpoint, or a damaged one.
        ImportError: a package that the world needs is not installed.
    """

    rewarded = True

    def __init__(self, path: Path) -> None:
        from dntorch.runs.run import load_trained

        path = Path(path)
        file = path / "checkpoint.pt" if path.is_dir() else path
        if not file.is_file():
            raise ValueError(f"{path} holds no run: name a folder with checkpoint.pt")
        self.agent, self.config = load_trained(file)
        self.structure, self.dt, self.title = self.agent, self.agent.dt, str(path)
        self.agent.learn(True)
        self._open()
        self.parts = watch(self.agent)
        self.shown = [k for k in self.parts if k.startswith(("sensorimotor", "behaviors.intent"))]
        nodes = [k for k, part in self.parts.items() if part.shape == [self.agent.n]]
        self.letters = dict.fromkeys([*nodes, *MATRICES], self.config.colors)
        noise = self.config.noise if self.config.lifelong else 0.0
        self._noise, self._exploration = noise, self._explorer()
        self.knobs = [
            Knob("learning", "exploration", 0.0, max(20.0, 2 * noise), lambda: self._noise,
                 self._explore),
            *self._learning_knobs(),
        ]  # fmt: skip
        for label, part in self.parts.items():
            self.knobs += part_knobs(label, part.part)
        self.reset()

    def _explorer(self) -> Any:
        from dntorch.noise import Exploration

        return Exploration(self.agent.n, self.config.seed, amplitude=1.0)

    def _explore(self, amplitude: float) -> None:
        if not amplitude >= 0:
            raise ValueError(f"exploration={amplitude} is negative: give 0 or more")
        self._noise = amplitude

    def _learning_knobs(self) -> list[Knob]:
        rate = self.agent.learner.values
        trace = self.agent.learner.trace
        return [
            knob
            for part, name in ((rate, "learning_rate"), (trace, "tau"))
            for knob in part_knobs("learning", part)
            if knob.name == name
        ]

    def _open(self) -> None:
        from dntorch.extras import require
        from dntorch.runs.worlds import WORLDS, build_world

        row, self._env = WORLDS[self.config.world], None
        if row.env is None:
            self._world = build_world(self.config, self.agent.senses)
            return
        require("gymnasium", *row.packages)
        from dntorch.envs.adaptor import GymWorld

        senses = tuple(dict.fromkeys((*self.agent.senses, "image")))
        self._env = row.env(self.config, senses=senses, render_mode="rgb_array")
        self._world = GymWorld(self._env)

    def reset(self) -> None:
        self.agent.reset()
        self._state = self._world.initial(seed=self.config.seed)
        self._observation = self._world.observe(self._state)
        self._paid, self._owed = torch.zeros(()), 0
        self._outside: np.ndarray | None = None
        self.found, self.rewards, self.given = 0, 0, 0

    def advance(self) -> None:
        from dntorch.envs.task import NOTHING

        reward = self._paid
        if self._owed:
            reward, self._owed = reward + self.config.reward, self._owed - 1
        noise = self._noise * self._exploration(self.agent.decisions)
        action = self.agent(self._observation, reward, noise)
        outcome, self._state = self._world.step(action, self._state)
        self._observation, self._paid = outcome.observation, outcome.reward
        self.found += int(outcome.found != NOTHING)
        self.rewards += int(outcome.completed)

    def reward(self) -> None:
        """The reward of the task, as long as the task gives it."""
        self._owed = self._world.task.steps
        self.given += 1

    def learn(self, on: bool) -> None:
        self.agent.learn(on)

    def images(self) -> dict[str, np.ndarray]:
        if self._env is None:
            return {}
        now = time.monotonic()
        if self._outside is None or now - self._looked > OUTSIDE:  # it takes longer than the rest
            self._outside, self._looked = self._env.render(), now
        return {"outside": self._outside, "camera": self._observation["image"].numpy()}

    def matrices(self) -> dict[str, np.ndarray]:
        from dntorch.show.extracts import value_image

        seen = self.agent.weights, self.agent.learner.trace.u
        return {title: value_image(_numbers(each)) for title, each in zip(MATRICES, seen)}

    def note(self) -> str:
        colors = self.config.colors
        wanted = self.parts.get("behaviors.intention")
        rates = wanted.output() if wanted else torch.zeros(1)
        wants = f"wants {colors[int(rates.argmax())]}" if bool((rates > 0.5).any()) else "decides"
        return (
            f"{wants}; rewarded {self.config.sequence} of {colors}; found {self.found}, "
            f"rewards {self.rewards}, by hand {self.given}"
        )

    def close(self) -> None:
        self._world.close()


def _numbers(tensor: Tensor) -> np.ndarray:
    return tensor.detach().to(torch.float32).numpy()


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
        return RunSource(path)
    from dntorch import cosivina

    return StructureSource(cosivina.load(path), str(path), cosivina.noise(path))

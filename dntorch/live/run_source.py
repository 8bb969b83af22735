"""The agent of a run, in a fresh world, while it is watched and rewarded."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dntorch.live.knobs import Knob, part_knobs
from dntorch.live.sources import Source
from dntorch.live.watched import watch

OUTSIDE = 0.25
"""Seconds between two views from outside."""
MATRICES = ("values (state by action)", "eligibility trace (state by action)")


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

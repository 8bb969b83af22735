"""One agent in one world, from its first step to its last, stoppable at any."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from dntorch import files
from dntorch.modules.sarsa import DNSarsa
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.config import Config
from dntorch.runs.record import Record
from dntorch.runs.worlds import build_world


class Trial:
    """A run of ``config.steps`` control steps: exploration first, then exploitation.

    The agent learns all along. ``advance`` may be called with any portions and ``save`` and
    ``load`` between them; the numbers are the same.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self.agent = build_agent(config)
        self.exploration = build_exploration(config)
        self.world = build_world(config, self.agent.senses)
        self.record = Record(config.steps, self.agent.n)
        self.observation = self.world.reset()
        self.reward = torch.zeros(())

    @property
    def step(self) -> int:
        """Control steps taken."""
        return self.record.length

    @property
    def finished(self) -> bool:
        return self.step >= self.config.steps

    @torch.inference_mode()
    def advance(self, steps: int) -> None:
        """Take up to ``steps`` control steps, not beyond the end of the run."""
        none = torch.zeros_like(self.agent.weights)
        state = self.agent.state
        for step in range(self.step, min(self.step + steps, self.config.steps)):
            exploring = step < self.config.explore
            noise = self.exploration(state.decisions) if exploring else none
            action, state = self.agent.step(self.observation, self.reward, noise, state)
            outcome = self.world.step(action)
            self.record.write(*self.agent.behaviors.output(state.behaviors), state.learner, outcome)
            self.observation, self.reward = outcome.observation, outcome.reward
        self.agent.state = state

    def close(self) -> None:
        self.world.close()

    def save(self, path: Path) -> None:
        """Write a checkpoint: all that is needed to go on to the very same numbers."""
        files.save(path, self.content())

    def content(self) -> dict[str, Any]:
        """What a checkpoint holds."""
        return {
            "config": asdict(self.config),
            "agent": self.agent.snapshot(),
            "world": self.world.snapshot(),
            "observation": self.observation,
            "reward": self.reward,
            "record": self.record.arrays(),
        }

    @classmethod
    def load(cls, path: Path) -> "Trial":
        """Go on from a checkpoint.

        Raises:
            ValueError: no checkpoint, a damaged one, or one of another architecture.
        """
        content = files.load(path)
        try:
            trial = cls(Config(**content["config"]))
            trial.agent.restore(content["agent"])
            trial.world.restore(content["world"])
            trial.record.restore(content["record"])
            trial.observation, trial.reward = content["observation"], content["reward"]
        except (KeyError, TypeError) as error:
            if "world" not in content:
                raise ValueError(
                    f"{path} holds learned values and no world: use it with export or robot run"
                ) from error
            raise ValueError(f"{path} is of another version of dntorch: {error}") from error
        return trial


def load_trained(path: Path) -> tuple[DNSarsa, Config]:
    """The agent of a checkpoint, with what it learned, without its world.

    Raises:
        ValueError: as `Trial.load`.
    """
    content = files.load(path)
    try:
        config = Config(**content["config"])
        agent = build_agent(config)
        agent.restore(content["agent"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path} is of another version of dntorch: {error}") from error
    return agent, config

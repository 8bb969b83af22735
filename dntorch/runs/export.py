"""From a run's checkpoint to artefacts, with a record of its agent in the world of the run."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import torch
from torch import Tensor

from dntorch.colors import HUES, NAMES
from dntorch.envs.task import NOTHING
from dntorch.export.agent import STEPS, at_work, drawn_by, resting, write_agent
from dntorch.export.artefacts import DEFAULT, checksum
from dntorch.export.boundary import Boundary
from dntorch.export.golden import Golden
from dntorch.modules.sarsa import DNSarsa
from dntorch.process import commit
from dntorch.runs.build import build_exploration
from dntorch.runs.config import Config
from dntorch.runs.run import load_trained
from dntorch.runs.train import CHECKPOINT
from dntorch.runs.worlds import build_world


def export_run(
    run: Path,
    folder: Path,
    runtimes: Sequence[str] = DEFAULT,
    prepare: Callable[[DNSarsa, Config], DNSarsa] = lambda agent, config: agent,
) -> Path:
    """Export the agent of a run: what it learned, at rest.

    Args:
        run: a folder that ``dntorch learn`` wrote.
        folder: where to; made if need be.
        runtimes: of `RUNTIMES`.
        prepare: makes of the agent what is exported, such as one that fits a robot.

    Raises:
        ValueError: no run there; an agent that never completes two behaviours.
        ImportError: a package for one of the formats is missing.
    """
    agent, config = load_trained(run / CHECKPOINT)
    agent = prepare(agent, config)
    world = Responding(config, agent.senses)
    boundary = resting(agent, world(None)[0])
    world.close()
    golden = closed_loop(boundary, config)
    about = {
        "colors": [
            {"letter": letter, "name": NAMES[letter], "hue": HUES[letter]}
            for letter in config.colors
        ],
        **drawn_by(build_exploration(config)),
        "source": {
            "commit": commit(),
            "config": asdict(config),
            "checkpoint_sha256": checksum(run / CHECKPOINT),
        },
    }
    return write_agent(boundary, golden, folder, runtimes, about)


class Responding:
    """The world of a run as a function, as `export_agent` wants it.

    Attributes:
        found: positions of the colours that were found, in their order.
        rewards: how often the sequence was completed.
    """

    def __init__(self, config: Config, senses: tuple[str, ...]) -> None:
        self.world, self.seed = build_world(config, senses), config.seed
        self.found, self.rewards = [], 0

    def __call__(self, action: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        if action is None:
            self.state = self.world.initial(seed=self.seed)
            return self.world.observe(self.state), torch.zeros(())
        outcome, self.state = self.world.step(action, self.state)
        self.found += [int(outcome.found)] if outcome.found != NOTHING else []
        self.rewards += int(outcome.completed)
        return outcome.observation, outcome.reward

    def close(self) -> None:
        self.world.close()


def closed_loop(boundary: Boundary, config: Config) -> Golden:
    """The agent at work in the world of a run, with rewards.

    So that a reward comes within the record whatever was learned, the rewarded sequence is
    that of the first two behaviours that this agent completes. A lamp shows progress in that
    sequence, and which behaviour comes second may depend on it: it is asked again.

    Raises:
        ValueError: it does not complete two behaviours, or completes them only once.
    """
    steps = max(800, round(STEPS / 32 / config.dt))
    golden, world = _record(boundary, config, steps)
    for _ in range(3):
        if len(world.found) < 2:
            raise ValueError(
                f"this agent completed {len(world.found)} behaviours in {steps} steps, too few for "
                "a record with a transition: train it, or another seed, first"
            )
        pair = "".join(config.colors[color] for color in world.found[:2])
        rewarding = replace(config, sequence=pair, then="", change=0)
        golden, world = _record(boundary, rewarding, steps)
        if world.rewards:
            return golden
    raise ValueError(f"no reward for {pair} in {steps} steps: export another seed's agent")


def _record(boundary: Boundary, config: Config, steps: int) -> tuple[Golden, Responding]:
    world = Responding(config, boundary.structure.senses)
    try:
        return at_work(boundary, world, build_exploration(config), steps), world
    finally:
        world.close()

"""From a trained agent's checkpoint to artefacts, with a record of it at work."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dntorch.colors import HUES, NAMES
from dntorch.envs.task import NOTHING
from dntorch.export.artefacts import DEFAULT, checksum, write
from dntorch.export.boundary import Boundary
from dntorch.export.golden import Golden, Outcome, record
from dntorch.modules.sarsa import DNSarsa
from dntorch.process import commit
from dntorch.runs.build import build_exploration
from dntorch.runs.config import Config
from dntorch.runs.train import CHECKPOINT
from dntorch.runs.trial import load_trained
from dntorch.runs.worlds import World, build_world

SECONDS = 28.2
"""Length of the golden record; at 32 control steps per second 902."""
UNITS = {
    "image": "RGB 0-255, row 0 at the top",
    "proximity": "infra-red readings ps0 to ps7, near is large",
    "wheels": "motor steps since the start, left wheel first, 1000 per turn",
    "match": "match of each behaviour, 0-1",
    "reward": "size of the reward signal, 1",
    "noise": "added to the values [action, state], 1; zeros are exploitation",
}
"""Of inputs by name; others are empty in the manifest."""


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
    agent.reset()
    agent.learn()
    observation = first_observation(config, agent.senses)
    boundary = Boundary(agent, observation, torch.zeros(()), torch.zeros(agent.n, agent.n))
    golden = closed_loop(boundary, config)
    about = _about(boundary, config)
    about["source"]["checkpoint_sha256"] = checksum(run / CHECKPOINT)
    return write(boundary, golden, folder, runtimes, "agent", about)


def first_observation(config: Config, senses: tuple[str, ...]) -> dict[str, Tensor]:
    """What a run's world shows at first."""
    world = build_world(config, senses)
    try:
        return world.reset()
    finally:
        world.close()


class Loop:
    """Closes the loop for a golden record: explores for a while, at last stops learning.

    One reward and one number of the noise are NaN, so that the record tells what becomes of them.
    """

    def __init__(self, config: Config, world: World, steps: int) -> None:
        self.world, self.steps = world, steps
        self.exploration = build_exploration(config)
        self.none = torch.zeros(len(config.colors), len(config.colors))
        self.observation, self.reward = world.reset(), torch.zeros(())
        self.found: list[int] = []
        self.rewards = 0

    def __call__(self, step: int, outcome: Outcome | None):
        noise = self.none
        if outcome is not None:
            answer = self.world.step(outcome.outputs[0])
            self.observation, self.reward = answer.observation, answer.reward
            self.found += [answer.found] if answer.found != NOTHING else []
            self.rewards += int(answer.completed)
            if 0.6 < step / self.steps < 0.8:
                noise = self.exploration(outcome.after["decisions"])
        reward = self.reward
        if step == self.steps // 4:
            reward = torch.full_like(reward, torch.nan)
        if step == self.steps // 2:
            noise = noise.clone()
            noise[0, 1] = torch.nan
        learning = torch.tensor(float(step / self.steps < 0.9))
        return (self.observation, reward, noise), {"learner.values.learning": learning}


def closed_loop(boundary: Boundary, config: Config) -> Golden:
    """The agent at work in its world, with rewards.

    So that a reward comes within the record whatever was learned, the rewarded sequence is
    that of the first two behaviours that this agent completes.
    """
    steps = max(800, round(SECONDS / config.dt))
    found = _run(boundary, config, steps)[1].found
    if len(found) < 2:
        raise ValueError(
            f"this agent completed {len(found)} behaviours in {steps} steps, too few for a record "
            "with a transition: train it, or another seed, first"
        )
    pair = "".join(config.colors[color] for color in found[:2])
    golden, loop = _run(boundary, replace(config, sequence=pair), steps)
    if not loop.rewards:
        raise ValueError(f"no reward for {pair} in {steps} steps: export another seed's agent")
    return golden


def _run(boundary: Boundary, config: Config, steps: int) -> tuple[Golden, Loop]:
    world = build_world(config, boundary.structure.senses)
    try:
        loop = Loop(config, world, steps)
        return record(boundary, loop, steps, _notable), loop
    finally:
        world.close()


def _notable(outcome: Outcome) -> bool:
    """Whether a behaviour was completed, or an input ignored."""
    counts = ("decisions", "ignored")
    return any(not torch.equal(outcome.before[name], outcome.after[name]) for name in counts)


def _about(boundary: Boundary, config: Config) -> dict[str, Any]:
    """What the manifest of an agent says besides that of a structure."""
    agent = boundary.structure
    drives = math.isfinite(agent.sensorimotor.max_speed)
    about: dict[str, Any] = {
        "units": {
            **{port.name: UNITS.get(port.name, "") for port in boundary.inputs},
            "action": "rad/s, left wheel first" if drives else "intentions, 0-1",
            "dt": "s",
        },
        "colors": [
            {"letter": letter, "name": NAMES[letter], "hue": HUES[letter]}
            for letter in config.colors
        ],
        "exploration": {"amplitude": config.noise, "seed": config.seed},
        "decisions": {
            "behaviors.intention.u": agent.behaviors.intention.threshold,
            "behaviors.satisfaction.u": agent.behaviors.satisfaction.threshold,
        },
        "source": {"commit": commit(), "config": asdict(config)},
    }
    if drives:
        about["max_speed"] = agent.sensorimotor.max_speed
    return about

"""From an agent to artefacts, with a record of it at work in its world."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dntorch.export.artefacts import DEFAULT, write
from dntorch.export.boundary import Boundary
from dntorch.export.golden import Golden, Taken, record
from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import Exploration

STEPS = 902
"""Length of the golden record: 28.2 s at 32 control steps per second."""
UNITS = {
    "image": "RGB 0-255, row 0 at the top",
    "proximity": "infra-red readings ps0 to ps7, near is large",
    "wheels": "motor steps since the start, left wheel first, 1000 per turn",
    "match": "match of each behaviour, 0-1",
    "lamp": "share of the rewarded sequence that is right so far, 0-1",
    "reward": "size of the reward signal, 1",
    "noise": "added to the values of actions, 1; zeros are exploitation",
}
"""Of inputs by name; others are empty in the manifest."""

Respond = Callable[[Tensor | None], tuple[dict[str, Tensor], Tensor]]
"""A world as a function: from an action, ``None`` at first, to observation and reward, ``()``."""


def export_agent(
    agent: DNSarsa,
    respond: Respond,
    folder: str | Path,
    runtimes: Sequence[str] = DEFAULT,
    *,
    exploration: Exploration | None = None,
    steps: int = STEPS,
    about: dict[str, Any] | None = None,
) -> Path:
    """Export an agent with what it learned, at rest; itself it stays as it is.

    Args:
        agent: without batch.
        respond: closes the loop while the golden record is made. It should reward the agent in
            that time, since a record without reward says nothing of learning.
        folder: where to; made if need be.
        runtimes: of `RUNTIMES`.
        exploration: noise in a part of the record.
        steps: length of the record, in control steps.
        about: entries of the manifest besides those of any agent, such as ``source``.

    Raises:
        ValueError: an unknown runtime, and as `resting`.
        ImportError: a package for one of the formats is missing.

    >>> from tempfile import TemporaryDirectory
    >>> from dntorch import DNSarsa
    >>> seen = {"match": torch.zeros(2)}, torch.tensor(1.0)
    >>> with TemporaryDirectory() as folder:
    ...     made = export_agent(DNSarsa(2), lambda action: seen, folder, ["torchscript"], steps=20)
    ...     sorted(path.name for path in made.iterdir())
    ['agent.ts', 'golden.npz', 'manifest.json', 'verify.py']
    """
    boundary = resting(agent, respond(None)[0])
    golden = at_work(boundary, respond, exploration, steps)
    if exploration is not None:
        about = drawn_by(exploration) | (about or {})
    return write_agent(boundary, golden, folder, runtimes, about)


def resting(agent: DNSarsa, observation: dict[str, Tensor]) -> Boundary:
    """The boundary of a copy of an agent, at rest, that learns.

    Raises:
        ValueError: a batch of agents; an observation that lacks what the agent senses.
    """
    if batch := list(agent.origin.shape):
        raise ValueError(f"agent is a batch of shape {batch}: export one, agent.select(index)")
    boundary = Boundary(agent, observation, torch.zeros(()), torch.zeros(agent.n))
    boundary.structure.reset()
    boundary.structure.learn()
    return boundary


def at_work(
    boundary: Boundary, respond: Respond, exploration: Exploration | None, steps: int
) -> Golden:
    """The agent of a boundary in a world, from its first moment on."""
    loop = _Loop(boundary.structure, respond, exploration, steps)
    return record(boundary, loop, steps, _notable)


def write_agent(
    boundary: Boundary,
    golden: Golden,
    folder: str | Path,
    runtimes: Sequence[str],
    about: dict[str, Any] | None = None,
) -> Path:
    """Write artefacts with a manifest that says what a robot needs to know of an agent."""
    content = _described(boundary) | (about or {})
    return write(boundary, golden, Path(folder), runtimes, "agent", content)


class _Loop:
    """Closes the loop for a golden record: explores for a while, at last stops learning.

    One reward and one number of the noise are NaN, so that the record tells what becomes of them.
    """

    def __init__(
        self, agent: DNSarsa, respond: Respond, exploration: Exploration | None, steps: int
    ) -> None:
        self.respond, self.exploration, self.steps = respond, exploration, steps
        self.none = torch.zeros(agent.n)
        names = dict(agent.named_buffers())
        self.switches = [name for name in names if name.endswith(".learning")]

    def __call__(self, step: int, taken: Taken | None):
        observation, reward = self.respond(None if taken is None else taken.outputs[0])
        noise, exploring = self.none, 0.6 < step / self.steps < 0.8
        if exploring and self.exploration is not None and taken is not None:
            noise = self.exploration(taken.after["decisions"])
        if step == self.steps // 4:
            reward = torch.full_like(reward, torch.nan)
        if step == self.steps // 2:
            noise = noise.clone()
            noise[1] = torch.nan
        learning = torch.tensor(float(step / self.steps < 0.9))
        return (observation, reward, noise), dict.fromkeys(self.switches, learning)


def _notable(taken: Taken) -> bool:
    """Whether a behaviour was completed, or an input ignored."""
    counts = ("decisions", "ignored")
    return any(not torch.equal(taken.before[name], taken.after[name]) for name in counts)


def drawn_by(exploration: Exploration) -> dict[str, Any]:
    """The entry of a manifest from which others draw the same noise."""
    settings = {"amplitude": exploration.amplitude, "seed": exploration.seed}
    return {
        "exploration": {k: v.item() if isinstance(v, Tensor) else v for k, v in settings.items()}
    }


def _described(boundary: Boundary) -> dict[str, Any]:
    """What the manifest of an agent says besides that of a structure."""
    agent = boundary.structure
    drives = math.isfinite(agent.sensorimotor.max_speed)
    about: dict[str, Any] = {
        "units": {
            **{port.name: UNITS.get(port.name, "") for port in boundary.inputs},
            "action": "rad/s, left wheel first" if drives else "intentions, 0-1",
            "dt": "s",
        },
        "thresholds": {
            "behaviors.intention.u": agent.behaviors.intention.threshold,
            "behaviors.satisfaction.u": agent.behaviors.satisfaction.threshold,
        },
    }
    return about | ({"max_speed": agent.sensorimotor.max_speed} if drives else {})

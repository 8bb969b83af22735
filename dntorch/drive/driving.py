"""Driving a robot: the control loop, and what came of it."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch

from dntorch.cells.functions import is_on
from dntorch.colors import NAMES
from dntorch.envs.adaptor import tensors
from dntorch.envs.hardware import HardwareEnv
from dntorch.envs.task import NOTHING, SequenceTask
from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import Exploration
from dntorch.runs.config import Config
from dntorch.runs.record import reported

Act = Callable[[dict[str, np.ndarray], float], tuple[np.ndarray, int]]
"""From observation and reward to wheel speeds in rad/s and the colour found now, or ``NOTHING``."""


class Step(NamedTuple):
    """One control step."""

    observation: dict[str, np.ndarray]
    """what it led to, as the agent senses it"""
    reward: float
    found: int
    """position of the colour that was reported before it, or ``NOTHING``"""
    info: dict[str, Any]
    """of the env"""


def acting(agent: DNSarsa, exploration: Exploration | None = None) -> Act:
    """An agent as something that drives, without noise unless there is an ``exploration``."""
    none, report = torch.zeros_like(agent.weights[..., 0]), Onset(agent.n)

    @torch.no_grad()
    def act(observation: dict[str, np.ndarray], reward: float) -> tuple[np.ndarray, int]:
        noise = none if exploration is None else exploration(agent.decisions, none.dtype)
        wheels = agent(tensors(observation), torch.tensor(reward), noise)
        _, satisfaction = agent.behaviors.output(agent.behaviors.state)
        return wheels.numpy(), report(satisfaction.numpy())

    return act


class Onset:
    """What an agent of ``n`` behaviours reports as found: which CoS node came on.

    Called with the firing rates of the nodes after each step; ``NOTHING`` if none came on.
    """

    def __init__(self, n: int) -> None:
        self._rates = np.zeros(n)

    def __call__(self, rates: np.ndarray) -> int:
        before, self._rates = self._rates, rates.copy()
        return int(reported(before, rates))


class Trip:
    """What came of driving a robot once.

    Args:
        config: of the run.
        scan: rad/s, how fast it turns while it looks for something. When nothing was found in
            the time of more than one such turn, something is wrong.
        vain: s more that its agent may spend on intentions in vain.

    Attributes:
        found: ``(step, position of the colour)`` of all that was reported.
        completed: steps in which the sequence was completed.
        late: s by which each step ended too late.
        stopped: why the robot stood although nobody said so, and for how many steps.
        fresh: steps with a new image.
        oldest: s, age of the oldest image on which it moved.
        connections: how often the link was made.
        ending: why it ended, or "".
    """

    def __init__(self, config: Config, scan: float, vain: float = 0.0) -> None:
        self.config, self.patience = config, 15 + 1.2 * math.tau / scan + vain
        self.found: list[tuple[int, int]] = []
        self.completed: list[int] = []
        self.late: list[float] = []
        self.stopped: Counter[str] = Counter()
        self.fresh, self.oldest, self.connections, self._quiet = 0, 0.0, 0, 0
        self.ending = ""

    @classmethod
    def of(cls, agent: DNSarsa, config: Config) -> "Trip":
        """That of an agent, which may give each of its intentions up before one succeeds."""
        waiting = agent.behaviors.dissatisfaction
        vain = 0.0 if waiting is None else agent.n * float(waiting.patience)
        return cls(config, agent.sensorimotor.scan, vain)

    @property
    def steps(self) -> int:
        return len(self.late)

    @property
    def letters(self) -> str:
        """Colours in the order in which they were reported."""
        return "".join(self.config.colors[color] for _, color in self.found)

    def write(self, step: Step) -> None:
        info = step.info
        if step.found != NOTHING:
            self.found.append((self.steps, step.found))
        if info["completed"]:
            self.completed.append(self.steps)
        # Standing still for want of images says nothing of the agent.
        self._quiet = 0 if step.found != NOTHING else self._quiet + (not info["stopped"])
        self.stopped.update([info["stopped"]] if info["stopped"] else [])
        self.fresh += int(info["fresh"])
        if info["speeds"].any() and math.isfinite(info["age"]):
            self.oldest = max(self.oldest, float(info["age"]))
        self.connections = int(info["connections"])
        self.late.append(float(info["late"]))

    def over(self, steps: int, iterations: int) -> bool:
        """Whether to end: so many steps or sequences, or nothing found; ``ending`` says which."""
        if len(self.completed) >= iterations:
            self.ending = f"the sequence was executed {iterations} times"
        elif self._quiet * self.config.dt >= self.patience:
            self.ending = f"nothing was found for {self.patience:.0f} s"
        elif self.steps >= steps:
            self.ending = f"{steps} steps were taken"
        return bool(self.ending)

    def summary(self) -> dict[str, Any]:
        """Numbers for a report."""
        late = 1e3 * np.array(self.late or [0.0])
        return {
            "ending": self.ending,
            "steps": self.steps,
            "seconds": round(self.steps * self.config.dt, 1),
            "found": self.letters,
            "found_at_step": [step for step, _ in self.found],
            "completed_at_step": self.completed,
            "images_per_second": round(self.fresh / max(1, self.steps) / self.config.dt, 2),
            "oldest_image_moved_on_s": round(self.oldest, 3),
            "late_ms": {
                "median": round(float(np.median(late)), 2),
                "p99": round(float(np.percentile(late, 99)), 2),
                "max": round(float(late.max()), 2),
            },
            "stood_steps": dict(self.stopped),
            "connections": self.connections,
        }


def perform(
    env: HardwareEnv,
    act: Act,
    trip: Trip,
    steps: int,
    iterations: int = 2,
    report: bool = True,
    each: Callable[[Step], Any] = lambda step: None,
) -> Trip:
    """Drive a robot from a reset on until `Trip.over`.

    Args:
        env, act: the robot, and what drives it.
        trip: is written; also what an error left of it.
        steps, iterations: at most so many control steps, and executions of the sequence.
        report: what is found counts for the task; otherwise a key press alone is rewarded.
        each: called after each step, when ``trip`` has it.

    Raises:
        ConnectionError: the link is lost.
    """
    try:
        observation, _ = env.reset()
        reward = 0.0
        while not trip.over(steps, iterations):
            wheels, found = act(observation, reward)
            if report and found != NOTHING:
                env.report(found)
            observation, reward, _, _, info = env.step(wheels)
            step = Step(observation, reward, found, info)
            trip.write(step)
            each(step)
    except BaseException as error:
        trip.ending = f"{type(error).__name__}: {error}".rstrip(": ")
        raise
    return trip


def spoken(agent: DNSarsa, config: Config) -> str:
    """What an agent is after, for people."""
    rates = agent.behaviors.intention.output(agent.behaviors.intention.state)
    wanted = int(rates.argmax())
    return f"find {NAMES[config.colors[wanted]]}" if is_on(rates[wanted]) else "deciding"


def why_not(trip: Trip, seen: str) -> str:
    """What kept a robot from executing the sequence twice in a row; "" if nothing did.

    Args:
        trip: of a drive that was to end after two executions.
        seen: letters of what the world saw it find.
    """
    both = min(len(seen), len(trip.letters))
    # The side that notices a last one later may lack it.
    if seen[:both] != trip.letters[:both] or abs(len(seen) - len(trip.letters)) > 1:
        return f"reported {trip.letters}, the world saw {seen}"
    if len(trip.completed) < 2:
        return f"{trip.ending} after {trip.letters or 'no behaviour'}"
    at = [step for step, _ in trip.found]
    between = at.index(trip.completed[1]) - at.index(trip.completed[0])
    period = SequenceTask(trip.config.sequence, trip.config.colors).period
    return "" if between == period else f"a detour: {trip.letters}"

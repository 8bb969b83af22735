"""Discrete SARSA(lambda): the reference learner, for many runs at once.

The state is the last behaviour, the action the next one; a reward of one arrives with the
behaviour that completes the sequence. After each transition (s, a) to (s', a'):

    delta = R + gamma Q(s',a') - Q(s,a);   Q += eta delta e;   e <- gamma lambda e

with ``e(s,a)`` raised by one (accumulating) or set to one (replacing) when a is taken in s.
TD(0) is lambda = 0.

Source: Sutton and Barto, "Reinforcement Learning", chapter 7 of the first edition.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dntorch.colors import PAPER, SEQUENCE, indices


@dataclass(frozen=True)
class Learning:
    """Parameters of the discrete learner."""

    rate: float
    trace_decay: float
    discount: float
    replacing: bool = False


class History(NamedTuple):
    """What happened in runs of equally many behaviours (shorter ones end with -1)."""

    behaviors: np.ndarray
    """int, ``(runs, T)``"""
    rewarded: np.ndarray
    """bool, ``(runs, T)``"""
    policy: np.ndarray
    """bool, ``(runs, T)``: greedy choice after this behaviour's update executes the sequence"""
    values: np.ndarray
    """``[state][action]`` at the end, ``(runs, n, n)``"""
    explored: np.ndarray
    """the same at the end of exploration"""
    error: np.ndarray
    """|delta|, ``(runs, T)``"""


class Sarsa:
    """Values and traces ``[run, state, action]``."""

    def __init__(self, runs: int, n: int, learning: Learning) -> None:
        self.learning, self.each = learning, np.arange(runs)
        self.values, self.trace = np.zeros((2, runs, n, n))

    def visit(self, state: np.ndarray, action: np.ndarray, where: np.ndarray) -> None:
        """``action`` is taken in ``state``, in the runs ``where``."""
        run, s, a = self.each[where], state[where], action[where]
        self.trace[run] *= self.learning.discount * self.learning.trace_decay
        self.trace[run, s, a] = 1 if self.learning.replacing else self.trace[run, s, a] + 1

    def learn(self, reward: np.ndarray, old: tuple, new: tuple, where: np.ndarray) -> np.ndarray:
        """Update by the transition from pair ``old`` to pair ``new``; returns delta."""
        q, following = self.values[(self.each, *old)], self.values[(self.each, *new)]
        delta = np.where(where, reward + self.learning.discount * following - q, 0)
        self.values += self.learning.rate * delta[:, None, None] * self.trace
        return delta


def greedy(values: np.ndarray, preference: np.ndarray, rectified: bool = False) -> np.ndarray:
    """Best action of each state, ``(..., n)``, equal values by ``preference``; no repeats.

    With ``rectified`` negative values count as zero, as the neural value nodes see them.
    """
    values = np.maximum(values, 0) if rectified else values
    n = values.shape[-1]
    barred = np.where(np.eye(n, dtype=bool), -np.inf, values + 1e-9 * preference)
    return barred.argmax(-1)


def executes(choice: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Whether a policy ``(..., n)``, followed from the first colour, runs through ``target``."""
    right = [choice[..., s] == a for s, a in zip(target[:-1], target[1:])]
    return np.logical_and.reduce(right)


def explore_or_exploit(
    learning: Learning,
    explore: np.ndarray,
    total: np.ndarray,
    seed: int,
    sequence: str = SEQUENCE,
    colors: str = PAPER,
    chances: np.ndarray | None = None,
) -> History:
    """Runs that choose at random for ``explore`` behaviours, then greedily up to ``total``.

    Args:
        explore, total: number of behaviours of each run.
        chances: of the next behaviour given the last two, ``(n, n, n)``, as counted in
            other runs; uniform over the other colours if not given.
    """
    n, runs, target = len(colors), len(total), np.array(indices(sequence, colors))
    random = np.random.default_rng(seed)
    if chances is None:
        chances = np.broadcast_to(1 - np.eye(n), (n, n, n))
    empty = chances.sum(-1, keepdims=True) == 0
    chances = np.where(empty, 1 - np.eye(n), chances)
    edges = np.cumsum(chances / np.maximum(chances.sum(-1, keepdims=True), 1e-12), -1)
    preference = np.arange(n) / n
    learner = Sarsa(runs, n, learning)
    record = _empty(runs, int(total.max()), n)
    first = random.integers(n, size=runs)
    state, action = np.full(runs, -1), first
    recent = np.full((runs, len(target)), -1)
    each = learner.each
    for t in range(int(total.max())):
        going = t < total
        recent = np.where(going[:, None], np.c_[recent[:, 1:], action], recent)
        reward = (recent == target).all(1) & going
        two_back = np.where(state < 0, action, state)
        draws = random.random(runs)
        chosen = (draws[:, None] >= edges[two_back, action]).sum(1).clip(max=n - 1)
        chosen = np.where(chosen == action, (action + 1) % n, chosen)
        best = greedy(learner.values, preference)[each, action]
        following = np.where(t + 1 < explore, chosen, best)
        known = going & (state >= 0)
        if t:
            delta = learner.learn(reward, (state, action), (action, following), known)
            record.error[:, t] = abs(delta)
        learner.visit(action, following, going)
        _write(record, t, action, reward, going, learner, target, preference, explore)
        state, action = action, following
    return record._replace(values=learner.values)


def yoked(
    learning: Learning,
    behaviors: np.ndarray,
    rewarded: np.ndarray,
    n: int,
    at: tuple[int, ...] = (),
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Learn from ``n`` behaviours ``(runs, T)`` that another chose (-1 after a run's end).

    Returns the values ``[run, state, action]`` after the last and after ``at`` behaviours.
    """
    runs, count = behaviors.shape
    learner, kept = Sarsa(runs, n, learning), {}
    for t in range(count - 1):
        if t in at:
            kept[t] = learner.values.copy()
        action, following = behaviors[:, t], behaviors[:, t + 1]
        going = (action >= 0) & (following >= 0)
        if t:
            state = behaviors[:, t - 1]
            learner.learn(rewarded[:, t], (state, action), (action, following), going)
        learner.visit(action, following, going)
    return learner.values, kept


def _empty(runs: int, count: int, n: int) -> History:
    flags = np.zeros((3, runs, count), bool)
    values = np.zeros((2, runs, n, n))
    return History(
        np.full((runs, count), -1), flags[0], flags[1], values[0], values[1],
        np.zeros((runs, count)),
    )  # fmt: skip


def _write(
    record: History,
    t: int,
    action: np.ndarray,
    reward: np.ndarray,
    going: np.ndarray,
    learner: Sarsa,
    target: np.ndarray,
    preference: np.ndarray,
    explore: np.ndarray,
) -> None:
    record.behaviors[going, t] = action[going]
    record.rewarded[:, t] = reward
    record.policy[:, t] = executes(greedy(learner.values, preference), target)
    ending = explore == t + 1
    record.explored[ending] = learner.values[ending]

"""Discrete SARSA(lambda) that chooses as the autonomous agent does: the reference without time.

It knows no phases: small noise is added to the values for ever, and what was tried in the present
context is less tempting until it is fresh again. The state may be more than the last behaviour.
"""

from typing import NamedTuple

import numpy as np

from dntorch.paper.discrete import Learning

SECONDS = 5.0
"""A behaviour takes, about."""


class Rule(NamedTuple):
    """How it chooses."""

    noise: float = 0.1
    order: int = 4
    """completions that make a context; -1: nothing becomes less tempting"""
    recovery: float = 1200.0
    """s"""
    sharpness: float = 3.0
    depth: int = 0
    """completions before the last one that make a state with it"""


def autonomous(
    learning: Learning,
    reward: float,
    rule: Rule,
    targets: np.ndarray,
    n: int,
    total: int,
    seed: int,
    then: tuple[np.ndarray, int] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Behaviours and whether each was rewarded, ``(runs, total)``.

    Args:
        learning: rate, lambda and discount.
        reward: of a completed sequence, in units of the values.
        rule: how it chooses.
        targets: rewarded sequence of each run, ``(runs, length)``.
        total: behaviours of a run.
        then: other sequences, and the behaviour from which on they are rewarded.
    """
    runs, each, random = len(targets), np.arange(len(targets)), np.random.default_rng(seed)
    states = n ** (rule.depth + 1)
    values, trace = np.zeros((2, runs, n, states))
    ages = np.full((runs, n ** max(rule.order, 0), n), np.inf)
    preference = 1e-3 * (1 + np.arange(n) / n)
    history = np.full((runs, total + 1), -1)
    rewarded = np.zeros((runs, total), bool)
    history[:, 0], state, action = random.integers(n, size=runs), None, None
    for t in range(total):
        if then is not None and t == then[1]:
            targets = then[0]
        length = targets.shape[1]
        if t + 1 >= length:
            rewarded[:, t] = (history[:, t + 1 - length : t + 1] == targets).all(1)
        left = np.ones((runs, n))
        context = _number(history, t, rule.order, n)
        if context is not None:
            left = (1 - np.exp(-SECONDS * ages[each, context] / rule.recovery)) ** rule.sharpness
        now = _number(history, t, rule.depth + 1, n)
        learned = np.zeros((runs, n)) if now is None else values[each, :, now]
        worth = np.maximum(learned + rule.noise * random.random((runs, n)) * left, 0) + preference
        worth[each, history[:, t]] = -1
        following = worth.argmax(1)
        if state is not None:
            delta = reward * rewarded[:, t] + learning.discount * learned[each, following]
            delta -= values[each, action, state]
            values += learning.rate * delta[:, None, None] * trace
        if now is not None:
            trace *= learning.discount * learning.trace_decay
            trace[each, following, now] += 1
        ages += 1
        if context is not None:
            ages[each, context, following] = 0
        state, action, history[:, t + 1] = now, following, following
    return history[:, :total], rewarded


def _number(history: np.ndarray, t: int, count: int, n: int) -> np.ndarray | None:
    """Number of the context of the last ``count`` behaviours; None while there are fewer."""
    if count < 0 or t + 1 < count:
        return None
    number = np.zeros(len(history), int)
    for k in range(count):
        number = number * n + history[:, t - k]
    return number

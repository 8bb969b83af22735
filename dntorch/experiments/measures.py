"""From events of many runs to what the paper makes claims about."""

from typing import Any, NamedTuple

import numpy as np

from dntorch.colors import indices
from dntorch.envs.task import SequenceTask
from dntorch.experiments.config import Config
from dntorch.experiments.discrete import executes
from dntorch.experiments.record import LOOK_BACK, SHARE
from dntorch.experiments.statistics import Fit, regression, summary, wilson

BASELINE = 1e-3
"""Innate preference of the value nodes, which decides where nothing has been learned."""


class Runs(NamedTuple):
    """Events of runs, one row a run and one column a CoS onset, padded with -1 (or 0)."""

    steps: np.ndarray
    """of each onset"""
    behaviors: np.ndarray
    """colour of each onset"""
    rewarded: np.ndarray
    """the sequence was completed with this behaviour"""
    error: np.ndarray
    """integrals of v and |v| since the onset before, ``(runs, T, 2)``"""
    weights: np.ndarray
    """``[run, onset, state, action]``, or empty"""
    disagreements: np.ndarray
    """onsets that the world did not judge as found, and finds without onset, ``(runs,)``"""
    trouble: np.ndarray
    """steps with two intentions on, steps without a state after the first, ``(2, runs)``"""


class Outcome(NamedTuple):
    """What became of each run, ``(runs,)`` each."""

    found: np.ndarray
    """completed the sequence while it explored"""
    optimal: np.ndarray
    """nine in ten of the possible rewards within its last 40 behaviours"""
    late: np.ndarray
    """optimal, but its values did not yet execute the sequence when exploration ended"""
    first: np.ndarray
    """behaviours until the first find, -1 if none while exploring"""
    needed: np.ndarray
    """behaviours until the values execute the sequence and do so to the end, -1 if never"""


def runs_from_events(events: dict[str, np.ndarray], count: int) -> Runs:
    """Rows of runs 0 to ``count - 1`` from what `Population.results` gives."""
    onset, find = events["onset"], events["find"]
    order = np.lexsort((onset[:, 1], onset[:, 0]))
    agent = onset[order, 0]
    column = np.arange(len(agent)) - np.searchsorted(agent, agent)
    shape = (count, int(column.max(initial=0)) + 1)
    steps, behaviors = np.full((2, *shape), -1, np.int64)
    steps[agent, column], behaviors[agent, column] = onset[order, 1], onset[order, 2]
    error = np.zeros((*shape, 2), np.float32)
    error[agent, column] = events["error"][order]
    weights = np.zeros((0,), np.float32)
    if "weights" in events:
        n = events["weights"].shape[-1]
        weights = np.zeros((*shape, n, n), np.float32)
        weights[agent, column] = events["weights"][order].swapaxes(-1, -2)
    rewarded = np.zeros(shape, bool)
    disagreements = np.zeros(count, np.int64)
    find = find[np.lexsort((find[:, 1], find[:, 0]))]
    edges = np.searchsorted(find[:, 0], np.arange(count + 1))
    for run in range(count):
        mine = find[edges[run] : edges[run + 1]]
        rewarded[run], disagreements[run] = match(steps[run], behaviors[run], mine[:, 1:])
    trouble = events["trouble"].copy()
    trouble[1] -= np.where(steps[:, 0] >= 0, steps[:, 0], trouble[1]).astype(trouble.dtype)
    return Runs(steps, behaviors, rewarded, error, weights, disagreements, trouble)


def match(
    steps: np.ndarray, behaviors: np.ndarray, finds: np.ndarray, within: int = 40
) -> tuple[np.ndarray, int]:
    """Which onsets belong to a find that completed the sequence; number of disagreements.

    Finds are rows (step, colour, completed). The agent's onset belongs to the find next to
    it, at most ``within`` control steps away.
    """
    rewarded = np.zeros(len(steps), bool)
    count = int((steps >= 0).sum())
    if count == 0 or len(finds) == 0:
        return rewarded, count + len(finds)
    place = np.searchsorted(steps[:count], finds[:, 0]).clip(max=count - 1)
    before = (place - 1).clip(min=0)
    nearer = abs(steps[before] - finds[:, 0]) < abs(steps[place] - finds[:, 0])
    place = np.where(nearer, before, place)
    fits = (abs(steps[place] - finds[:, 0]) <= within) & (behaviors[place] == finds[:, 1])
    rewarded[place[fits & (finds[:, 2] > 0)]] = True
    matched = len(np.unique(place[fits]))
    return rewarded, max(count - matched, 0) + max(len(finds) - matched - 1, 0)


def policies(weights: np.ndarray, config: Config) -> np.ndarray:
    """Whether the greedy choice by values ``[..., state, action]`` executes the sequence."""
    n = weights.shape[-1]
    wanted = np.maximum(weights, 0) + BASELINE * (1 + np.arange(n) / n)
    choice = np.where(np.eye(n, dtype=bool), -np.inf, wanted).argmax(-1)
    return executes(choice, np.array(indices(config.sequence, config.colors)))


def needed_rewards(config: Config) -> int:
    return int(SHARE * LOOK_BACK / SequenceTask(config.sequence, config.colors).period)


def outcome(
    rewarded: np.ndarray,
    policy: np.ndarray,
    explored: np.ndarray,
    total: np.ndarray,
    needed_rewards: int = 9,
) -> Outcome:
    """Judge runs of ``total`` behaviours, the first ``explored`` of them random.

    ``policy`` (runs, T) says whether the values after each behaviour execute the sequence.
    """
    column = np.arange(rewarded.shape[1])
    exploring = column < explored[:, None]
    early = rewarded & exploring
    found = early.any(1)
    last = (column >= total[:, None] - LOOK_BACK) & (column < total[:, None])
    optimal = ((rewarded & last).sum(1) >= needed_rewards) & (total >= LOOK_BACK)
    if policy.size == 0:
        nothing = np.full(len(found), -1)
        return Outcome(found, optimal, found & False, np.where(found, early.argmax(1), -1), nothing)
    wrong = ~policy & (column < total[:, None])
    last_wrong = np.where(wrong.any(1), wrong.shape[1] - 1 - wrong[:, ::-1].argmax(1), -1)
    ever = last_wrong + 1 < total
    at_end = policy[np.arange(len(found)), (explored - 1).clip(min=0)]
    return Outcome(
        found,
        optimal,
        found & optimal & ~at_end,
        np.where(found, early.argmax(1), -1),
        np.where(ever, last_wrong + 2, -1),
    )


def neural_outcome(runs: Runs, config: Config) -> tuple[Outcome, np.ndarray, np.ndarray]:
    """Outcome, number of behaviours in exploration, number of behaviours in all."""
    explored = ((runs.steps >= 0) & (runs.steps < config.explore)).sum(1)
    total = (runs.steps >= 0).sum(1)
    policy = runs.weights.astype(bool)
    if policy.size:
        # What was learned from a behaviour is in the weights at the onset of the next.
        policy = policies(runs.weights[:, 1:], config)
        policy = np.concatenate((policy, policy[:, -1:]), 1)
        each = np.arange(len(total))
        policy[each, total - 1] = policy[each, (total - 2).clip(min=0)]
    return outcome(runs.rewarded, policy, explored, total, needed_rewards(config)), explored, total


def proportion(flags: np.ndarray, among: np.ndarray | None = None) -> list[int]:
    """``[k, n]``"""
    flags = flags if among is None else flags[among]
    return [int(flags.sum()), len(flags)]


def describe(outcome: Outcome) -> dict[str, Any]:
    """The entry of ``results.json`` for one kind of learner."""
    good = outcome.found & outcome.optimal & (outcome.needed > 0)
    entry: dict[str, Any] = {
        "found": proportion(outcome.found),
        "optimal_given_found": proportion(outcome.optimal, outcome.found),
        "optimal_given_not_found": proportion(outcome.optimal, ~outcome.found),
        "optimal_only_in_exploitation": proportion(outcome.late, outcome.found),
        "behaviors_to_find": summary(outcome.first[outcome.found] + 1),
        "behaviors_to_optimal": summary(outcome.needed[good]),
        "behaviors_from_find_to_optimal": summary((outcome.needed - outcome.first - 1)[good]),
    }
    for key in list(entry):
        if isinstance(entry[key], list):
            entry[key + "_interval"] = list(wilson(*entry[key]))
    return entry


# ---------------------------------------------------------------------- transitions


class Transitions(NamedTuple):
    """From one onset to the next: what the old pair's weight did, and what it should follow."""

    run: np.ndarray
    onset: np.ndarray
    step: np.ndarray
    change: np.ndarray
    next: np.ndarray
    """gamma Q(s',a')"""
    old: np.ndarray
    """-Q(s,a)"""
    rewarded: np.ndarray
    earlier: np.ndarray
    """weight change of the pair before the old one, nan if it is the same or unknown"""


def transitions(runs: Runs, which: np.ndarray, discount: float = 0.8) -> Transitions:
    """All transitions of the runs ``which`` (bool)."""
    c = runs.behaviors
    run, k = np.nonzero((c[:, 2:] >= 0) & which[:, None])
    k = k + 1
    s, a, b = c[run, k - 1], c[run, k], c[run, k + 1]
    w, later = runs.weights[run, k], runs.weights[run, k + 1]
    each = np.arange(len(run))
    before = np.where(k >= 2, c[run, k - 2], -1)
    other = (before >= 0) & ~((before == a) & (b == s))  # not where it runs again at once
    earlier = np.where(other, later[each, before, s] - w[each, before, s], np.nan)
    return Transitions(
        run, k, runs.steps[run, k], later[each, s, a] - w[each, s, a],
        discount * w[each, a, b], -w[each, s, a], runs.rewarded[run, k].astype(float), earlier,
    )  # fmt: skip


def update_regression(t: Transitions, select: np.ndarray | None = None) -> Fit:
    """Weight change of the old pair on gamma Q(s',a'), -Q(s,a) and reward."""
    columns = np.stack((t.next, t.old, t.rewarded), 1).astype(float)
    change = t.change.astype(float)
    return regression(*((columns, change) if select is None else (columns[select], change[select])))


def measured_decay(t: Transitions) -> Fit:
    """Gamma lambda: what the pair before the old one learns against what the old one learns.

    Without rewarded transitions: a reward begins while the old pair still runs and does not
    learn, but the one before it does.
    """
    known = np.isfinite(t.earlier) & (abs(t.change) > 1e-4) & (t.rewarded == 0)
    return regression(t.change[known, None].astype(float), t.earlier[known].astype(float))


def transition_counts(runs: Runs, explore: int, n: int) -> np.ndarray:
    """How often behaviour k followed i, j in exploration, ``[i, j, k]``."""
    c, counts = runs.behaviors, np.zeros((n, n, n), np.int64)
    valid = (c[:, 2:] >= 0) & (runs.steps[:, 2:] < explore) & (runs.steps[:, 2:] >= 0)
    np.add.at(counts, (c[:, :-2][valid], c[:, 1:-1][valid], c[:, 2:][valid]), 1)
    return counts


def correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pearson's r of the off-diagonal values of two ``(..., n, n)``, nan where one is constant."""
    off = ~np.eye(a.shape[-1], dtype=bool)
    x, y = a[..., off].astype(float), b[..., off].astype(float)
    x, y = x - x.mean(-1, keepdims=True), y - y.mean(-1, keepdims=True)
    norm = np.sqrt((x**2).sum(-1) * (y**2).sum(-1))
    return np.where(norm > 1e-12, (x * y).sum(-1) / np.maximum(norm, 1e-12), np.nan)

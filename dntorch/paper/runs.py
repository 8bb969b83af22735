"""Events of many runs, in rows and columns."""

from typing import NamedTuple

import numpy as np


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

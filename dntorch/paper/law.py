"""What a transition teaches: the weight change of the old pair, and what it should follow."""

from typing import NamedTuple

import numpy as np

from dntorch.paper.runs import Runs
from dntorch.paper.statistics import Fit, regression


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


def transitions(runs: Runs, which: np.ndarray, discount: float) -> Transitions:
    """All transitions of the runs ``which`` (bool), of learners that ``discount`` by gamma."""
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


def transition_counts(runs: Runs, explore: int, n: int, unrewarded: bool = False) -> np.ndarray:
    """How often behaviour k followed i, j in exploration, ``[i, j, k]``.

    ``unrewarded``: up to the first find only, while chance alone decides.
    """
    c, counts = runs.behaviors, np.zeros((n, n, n), np.int64)
    valid = (c[:, 2:] >= 0) & (runs.steps[:, 2:] < explore) & (runs.steps[:, 2:] >= 0)
    if unrewarded:
        valid &= (runs.rewarded.cumsum(1) - runs.rewarded)[:, 2:] == 0
    np.add.at(counts, (c[:, :-2][valid], c[:, 1:-1][valid], c[:, 2:][valid]), 1)
    return counts


def correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pearson's r of the off-diagonal values of two ``(..., n, n)``, nan where one is constant."""
    off = ~np.eye(a.shape[-1], dtype=bool)
    x, y = a[..., off].astype(float), b[..., off].astype(float)
    x, y = x - x.mean(-1, keepdims=True), y - y.mean(-1, keepdims=True)
    norm = np.sqrt((x**2).sum(-1) * (y**2).sum(-1))
    return np.where(norm > 1e-12, (x * y).sum(-1) / np.maximum(norm, 1e-12), np.nan)

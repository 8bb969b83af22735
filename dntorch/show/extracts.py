"""What the figures of a run are drawn from: its last behaviours, errors, strongest pairs."""

import numpy as np

from dntorch.envs.task import NOTHING
from dntorch.runs.record import Record

CHUNK, LONGEST, SMOOTH = 8, 4000, 20
"""Behaviours and most control steps of a chunk; transitions in the running mean of the error."""


def value_image(weights: np.ndarray) -> np.ndarray:
    """Weights ``[action, state]`` as the paper shows them, transposed: the state goes down."""
    return np.asarray(weights).T


def chunk(record: Record, first: int, last: int) -> slice:
    """The last `CHUNK` behaviours completed within the steps from ``first`` up to ``last``."""
    last = min(last, record.length)
    ends = first + np.flatnonzero(record.reported[first:last] != NOTHING)
    # Half a second more shows how the last completion ends its intention.
    begin, end = (ends[-CHUNK - 1], ends[-1] + 16) if len(ends) > CHUNK else (first, last)
    return slice(max(begin, end - LONGEST, 0), max(min(end, last), 0))


def mean_errors(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Step at which each transition ended, and the mean size of the value cell during it."""
    ends = np.flatnonzero(record.reported[: record.length] != NOTHING)
    if len(ends) < 2:
        return ends[:0], np.zeros(0)
    sums = np.add.reduceat(np.abs(record.error[: ends[-1]], dtype=np.float64), ends[:-1])
    return ends[1:], sums / np.diff(ends)


def running_mean(values: np.ndarray, width: int = SMOOTH) -> np.ndarray:
    """Mean of the last ``width`` values, of fewer at the beginning."""
    ends = range(1, len(values) + 1)
    return np.array([values[max(0, end - width) : end].mean() for end in ends])


def strongest(pairs: np.ndarray, count: int = CHUNK) -> list[tuple[int, int]]:
    """Pairs ``(action, state)`` of largest size in ``(T, n, n)``, but none near zero."""
    peaks = np.abs(pairs).max(0, initial=0)
    order = np.argsort(-peaks, axis=None, kind="stable")[:count]
    found = [tuple(map(int, np.unravel_index(k, peaks.shape))) for k in order]
    return [pair for pair in found if peaks[pair] > max(1e-3, 0.05 * peaks.max())]

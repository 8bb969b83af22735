"""What happened to many agents: onsets of CoS nodes, and finds of the world.

They are logged inside a compiled step without a branch: every step writes into the row of the
*next* event, and only an event moves on to another row.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dntorch.envs.nodes import NodesStep
from dntorch.envs.task import NOTHING
from dntorch.runs.chance import ROWS
from dntorch.runs.group import Group


class Log(NamedTuple):
    """Rows of a portion and how many of them are events, for onsets of CoS and for finds."""

    onsets: Tensor
    """number of onsets, ``(batch,)``"""
    onset: Tensor
    """step and colour, ``(ROWS, 2, batch)``"""
    weights: Tensor
    """``[action, state]``, ``(ROWS, n, n, batch)``"""
    error: Tensor
    """integrals of v and |v| since the onset before, ``(ROWS, 2, batch)``"""
    finds: Tensor
    find: Tensor
    """step, colour, number of completed sequences, ``(ROWS, 3, batch)``"""


def empty_log(batch: int, n: int, dtype: torch.dtype) -> Log:
    zeros = torch.zeros
    return Log(
        zeros(batch, dtype=torch.int64),
        zeros(ROWS, 2, batch, dtype=torch.int32),
        zeros(ROWS, n, n, batch, dtype=dtype),
        zeros(ROWS, 2, batch, dtype=dtype),
        zeros(batch, dtype=torch.int64),
        zeros(ROWS, 3, batch, dtype=torch.int32),
    )


def write(
    log: Log, step: Tensor, risen: Tensor, error: Tensor, outcome: NodesStep, weights: Tensor | None
) -> Log:
    """Log one control step, in place but for the counts.

    Args:
        risen: CoS nodes that came on, ``(batch, n)``.
        error: integrals since the last onset, ``(2, batch)``.
        weights: ``(batch, n, n)``, or None to keep none.
    """
    batch = risen.shape[0]
    each, now = torch.arange(batch), step.to(torch.int32).expand(batch)
    row = log.onsets.clamp_max(ROWS - 1)
    color = risen.to(torch.int32).argmax(-1).to(torch.int32)
    log.onset[row, :, each] = torch.stack((now, color), -1)
    log.error[row, :, each] = error.movedim(0, -1)
    if weights is not None:
        log.weights[row, :, :, each] = weights
    row = log.finds.clamp_max(ROWS - 1)
    find = torch.stack((now, outcome.found.to(torch.int32), outcome.completed.to(torch.int32)))
    log.find[row, :, each] = find.movedim(0, -1)
    return log._replace(
        onsets=log.onsets + risen.any(-1), finds=log.finds + (outcome.found != NOTHING)
    )


class Events:
    """Events of a `Group`, gathered portion by portion; arrays by name."""

    def __init__(self, group: Group) -> None:
        self.rows = torch.tensor(group.rows or group.agents, dtype=torch.int32)
        self.keep_weights = group.keep_weights
        self.parts: dict[str, list[np.ndarray]] = {}

    def collect(self, log: Log) -> None:
        """Take what a portion logged, and empty the log."""
        onsets, finds = log.onsets.clamp_max(ROWS), log.finds.clamp_max(ROWS)
        self._take("onset", log.onset, onsets)
        self._take("error", log.error, onsets)
        if self.keep_weights:
            self._take("weights", log.weights, onsets)
        self._take("find", log.find, finds)
        log.onsets.zero_()
        log.finds.zero_()

    def _take(self, name: str, rows: Tensor, counts: Tensor) -> None:
        used = torch.arange(ROWS).unsqueeze(-1) < counts  # (ROWS, batch)
        row, agent = used.nonzero(as_tuple=True)
        kept = rows.movedim(-1, 1)[row, agent]
        if name in ("onset", "find"):
            kept = torch.cat((self.rows[agent].unsqueeze(-1), kept), -1)
        self.parts.setdefault(name, []).append(kept.numpy().copy())

    def put(self, name: str, value: Tensor) -> None:
        """Keep a moment of all agents, ``(batch, ...)``."""
        self.parts[name] = [value.contiguous().numpy().copy()]

    def arrays(self) -> dict[str, np.ndarray]:
        """In the order in which they were gathered."""
        return {name: np.concatenate(parts) for name, parts in self.parts.items()}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from `arrays`."""
        self.parts = {name: [array] for name, array in arrays.items()}

    def joined(self) -> dict[str, np.ndarray]:
        """In order of agents and steps."""
        joined = self.arrays()
        for leader, names in (("onset", ("error", "weights", "onset")), ("find", ("find",))):
            order = np.lexsort((joined[leader][:, 1], joined[leader][:, 0]))
            joined |= {name: joined[name][order] for name in names if name in joined}
        return joined

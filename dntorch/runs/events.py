"""What happened to agents, as events: onsets of CoS nodes, and finds of the world.

They are logged inside a compiled step without a branch: every step writes into the row of the
*next* event, and only an event moves on to another row. So the memory of a run grows with what
happens, not with time.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dntorch.cells.functions import came_on, is_on
from dntorch.envs.task import NOTHING
from dntorch.envs.world import Outcome
from dntorch.modules.sarsa import AgentState, DNSarsa
from dntorch.runs.chance import ROWS


class Log(NamedTuple):
    """Rows of a portion and how many of them are events, for onsets of CoS and for finds."""

    step: Tensor
    """control steps taken"""
    onsets: Tensor
    """number of onsets, ``(*batch,)``"""
    onset: Tensor
    """step and colour, ``(*batch, ROWS, 2)``"""
    weights: Tensor
    """``[action, state]``, ``(*batch, ROWS, n, states)``"""
    error: Tensor
    """integrals of v and |v| since the onset before, ``(*batch, ROWS, 2)``"""
    running: Tensor
    """the same since the last onset, ``(*batch, 2)``"""
    finds: Tensor
    find: Tensor
    """step, colour, whether the sequence was completed, ``(*batch, ROWS, 3)``"""
    trouble: Tensor
    """steps with two intentions on, steps without a state, ``(*batch, 2)``"""


class Events:
    """Events of agents, as the memory of an `Engine`; arrays by name.

    ================  =====================  ==================================================
    array             shape                  meaning
    ================  =====================  ==================================================
    ``onset``         ``(events, 3)``        agent, step and colour of a CoS node that came on
    ``error``         ``(events, 2)``        integrals of v and \\|v\\| since the onset before
    ``weights``       ``(events, n, s)``     values ``[action, state]`` at an onset
    ``find``          ``(events, 3 + 1)``    agent, step, colour, whether it was rewarded
    ================  =====================  ==================================================

    Args:
        agent: whose nodes are watched.
        names: what to call each agent of the batch in the events, int.
        keep_weights: remember the values at every onset.
    """

    def __init__(self, agent: DNSarsa, names: tuple[int, ...], keep_weights: bool = True) -> None:
        self.agent, self.keep_weights = agent, keep_weights
        self.names = torch.tensor(names, dtype=torch.int32)
        self.parts: dict[str, list[np.ndarray]] = {}
        self.step, self.running = 0, np.zeros(0)
        self.trouble = np.zeros((2, len(names)), np.int64)

    # ------------------------------------------------------------------ memory of an engine

    def log(self, agent: AgentState, _rows: int) -> Log:
        count, weights = agent.decisions, agent.learner.values.weights
        batch, pairs = count.shape, weights.shape[-2:]

        def zeros(*shape: int, like: Tensor = count, **options) -> Tensor:
            return torch.zeros((*batch, *shape), dtype=like.dtype, device=like.device)

        return Log(
            torch.zeros_like(count.sum()),
            zeros(),
            zeros(ROWS, 2),
            zeros(ROWS, *pairs, like=weights),
            zeros(ROWS, 2, like=weights),
            zeros(2, like=weights),
            zeros(),
            zeros(ROWS, 3),
            zeros(2),
        )

    def write(
        self, log: Log, _row: Tensor, before: AgentState, after: AgentState, outcome: Outcome
    ) -> Log:
        """Log one control step; rows are written in place."""
        intention, satisfaction = self.agent.behaviors.output(after.behaviors)
        was = self.agent.behaviors.satisfaction.output(before.behaviors.satisfaction)
        risen = came_on(was, satisfaction)
        v = after.learner.opposition.error
        running = log.running + self.agent.dt * torch.stack((v, v.abs()), -1)
        now = log.step.expand(v.shape)
        put(log.onset, log.onsets, torch.stack((now, risen.to(now.dtype).argmax(-1)), -1))
        put(log.error, log.onsets, running)
        if self.keep_weights:
            put(log.weights, log.onsets, after.learner.values.weights)
        find = (now, outcome.found.to(now.dtype), outcome.completed.to(now.dtype))
        put(log.find, log.finds, torch.stack(find, -1))
        onset = risen.any(-1)
        trouble = (is_on(intention).sum(-1) > 1, ~is_on(satisfaction).any(-1))
        return log._replace(
            step=log.step + 1,
            onsets=log.onsets + onset,
            running=torch.where(onset.unsqueeze(-1), 0, running),
            finds=log.finds + (outcome.found != NOTHING),
            trouble=log.trouble + torch.stack(trouble, -1),
        )

    def collect(self, log: Log, _first: int, _steps: int) -> None:
        """Take what a portion logged, and empty the log."""
        for counts, names in ((log.onsets, ("onset", "error", "weights")), (log.finds, ("find",))):
            for name in names:
                if name != "weights" or self.keep_weights:
                    self._take(name, getattr(log, name), counts)
            counts.zero_()
        self.step = int(log.step)
        self.running = log.running.cpu().numpy().copy()
        self.trouble = log.trouble.reshape(-1, 2).cpu().numpy().T.copy()

    def _take(self, name: str, rows: Tensor, counts: Tensor) -> None:
        counts, rows = counts.reshape(-1).cpu(), rows.reshape(-1, *rows.shape[counts.dim() :]).cpu()
        used = torch.arange(ROWS).unsqueeze(-1) < counts  # (ROWS, agents): in order of time
        row, agent = used.nonzero(as_tuple=True)
        kept = rows[agent, row]
        if name in ("onset", "find"):
            kept = torch.cat((self.names[agent].unsqueeze(-1), kept.to(torch.int32)), -1)
        self.parts.setdefault(name, []).append(kept.numpy().copy())

    def put(self, name: str, value: Tensor) -> None:
        """Keep a moment of all agents, ``(*batch, ...)``."""
        self.parts[name] = [value.cpu().contiguous().numpy().copy()]

    # ------------------------------------------------------------------ what it holds

    def arrays(self) -> dict[str, np.ndarray]:
        """In the order in which they were gathered; ``trouble`` is ``(2, agents)``."""
        gathered = {name: np.concatenate(parts) for name, parts in self.parts.items()}
        return gathered | {"trouble": self.trouble}

    def snapshot(self) -> dict[str, np.ndarray]:
        """What a resume needs, after a portion was collected."""
        return self.arrays() | {"running": self.running, "step": np.array(self.step)}

    def restore(self, snapshot: dict[str, np.ndarray], log: Log) -> Log:
        """Go on from a `snapshot`; the log to go on with."""
        self.parts = {name: [array] for name, array in snapshot.items()}
        self.trouble, self.running = self.parts.pop("trouble")[0], self.parts.pop("running")[0]
        self.step = int(self.parts.pop("step")[0])
        trouble = torch.from_numpy(self.trouble.T.copy()).reshape(log.trouble.shape)
        return log._replace(
            step=torch.full_like(log.step, self.step),
            running=torch.from_numpy(self.running.copy()).to(log.running),
            trouble=trouble.to(log.trouble),
        )

    def joined(self) -> dict[str, np.ndarray]:
        """In order of agents and steps."""
        joined = self.arrays()
        for leader, names in (("onset", ("error", "weights", "onset")), ("find", ("find",))):
            order = np.lexsort((joined[leader][:, 1], joined[leader][:, 0]))
            joined |= {name: joined[name][order] for name in names if name in joined}
        return joined


def put(rows: Tensor, count: Tensor, value: Tensor) -> None:
    """Write ``value`` into row number ``count`` of each agent, in place."""
    if count.dim() == 0:
        rows, count, value = rows.unsqueeze(0), count.unsqueeze(0), value.unsqueeze(0)
    each = torch.arange(len(count), device=count.device)
    # An assignment by index, unlike scatter, is compiled without a copy of all rows.
    rows[each, count.clamp_max(ROWS - 1)] = value.to(rows.dtype)

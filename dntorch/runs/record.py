"""What happened in a run, step by step: all of it."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dntorch.cells.functions import came_on, is_on
from dntorch.cells.node import NodeState
from dntorch.envs.task import NOTHING
from dntorch.envs.world import Outcome
from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.sarsa import AgentState

LOOK_BACK, SHARE = 40, 0.9
"""An agent is *optimal* with nine in ten of the rewards that its last 40 behaviours could
bring: 9 for G-B-Y-R-G, where every fourth behaviour can be rewarded."""


def enough(period: int) -> int:
    """Rewards within `LOOK_BACK` behaviours that make an agent optimal.

    At best there is one reward per ``period`` behaviours.
    """
    return int(SHARE * LOOK_BACK / period)


def reported(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Position of the CoS node that came on between two firing rates ``(*any, n)``.

    This is the colour that an agent reports as found; ``NOTHING`` where no node came on, the
    first where several did.
    """
    new = came_on(before, after)
    return np.where(new.any(-1), new.argmax(-1), NOTHING)


class Rows(NamedTuple):
    """A portion of steps as they are written, ``(rows, *batch, ...)``; see `Record`."""

    intention: Tensor
    satisfaction: Tensor
    trace: Tensor
    error: Tensor
    weights: Tensor
    reward: Tensor
    found: Tensor
    completed: Tensor


class Record:
    """One row a control step, for an agent of n behaviours, or a batch of them.

    ================  ==================  =====================================================
    array             dtype, shape        meaning, after the step
    ================  ==================  =====================================================
    ``intention``     float32 (T, n)      firing rate of the intention nodes
    ``satisfaction``  float32 (T, n)      firing rate of the CoS nodes
    ``trace``         float32 (T, n, n)   eligibility ``[action, state]``
    ``error``         float32 (T,)        value cell: TD error without the reward
    ``reward``        float32 (T,)        reward signal of the world
    ``found``         int8 (T,)           colour that the world judged as found, or -1
    ``completed``     bool (T,)           the rewarded sequence was completed
    ``reported``      int8 (T,)           colour whose CoS node came on, or -1
    ``weights``       float32 (T/s,n,n)   values ``[action, state]`` every `SPARSE` steps
    ================  ==================  =====================================================

    The n states of ``trace`` and ``weights`` are ``states`` if the agent recalls more than the
    last completion. A batch stands behind T. As the memory of an `Engine` it is written portion by
    portion.

    Args:
        steps: control steps that there is room for.
        behaviors: of the agent: they say what an activation is as a firing rate.
        batch: of the agents.
        states: how many states the agent has, by default as many as behaviours.
    """

    SPARSE = 100

    def __init__(
        self,
        steps: int,
        behaviors: ElementaryBehaviors,
        batch: tuple[int, ...] = (),
        states: int | None = None,
    ) -> None:
        self.length, self.behaviors_of, n = 0, behaviors, behaviors.n
        self.states = states or n
        self.intention = np.zeros((steps, *batch, n), np.float32)
        self.satisfaction = np.zeros((steps, *batch, n), np.float32)
        self.trace = np.zeros((steps, *batch, n, self.states), np.float32)
        self.error = np.zeros((steps, *batch), np.float32)
        self.reward = np.zeros((steps, *batch), np.float32)
        self.found = np.full((steps, *batch), NOTHING, np.int8)
        self.completed = np.zeros((steps, *batch), np.bool_)
        self.reported = np.full((steps, *batch), NOTHING, np.int8)
        self.weights = np.zeros((-(-steps // self.SPARSE), *batch, n, self.states), np.float32)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays, cut to the steps that were recorded."""
        cut = {k: v[: self.length] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return cut | {"weights": self.weights[: -(-self.length // self.SPARSE)]}

    def snapshot(self) -> dict[str, np.ndarray]:
        """What a resume needs, after a portion was collected."""
        return self.arrays()

    def restore(self, snapshot: dict[str, np.ndarray], log: Rows | None = None) -> Rows | None:
        """Put recorded arrays back at the beginning; the log to go on with."""
        length = len(snapshot["error"])
        own = {name: array for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        for name, array in own.items():
            rows = -(-length // self.SPARSE) if name == "weights" else length
            form = (rows, *array.shape[1:]), array.dtype
            if rows > len(array) or (snapshot[name].shape, snapshot[name].dtype) != form:
                raise TypeError(f"{name} has not a row for each of {length} steps")
        self.length = length
        for name, array in own.items():
            array[: len(snapshot[name])] = snapshot[name]
        return log

    def member(self, k: int) -> "Record":
        """The record of one agent of a batch."""
        own = Record(len(self.error), self.behaviors_of, states=self.states)
        own.restore({name: array[:, k] for name, array in self.arrays().items()})
        return own

    # ------------------------------------------------------------------ memory of an engine

    def log(self, agent: AgentState, rows: int) -> Rows:
        """Room for a portion of steps."""
        behaviors, learner, count = agent.behaviors, agent.learner, agent.decisions

        def room(like: Tensor, dtype: torch.dtype | None = None) -> Tensor:
            return torch.zeros((rows, *like.shape), dtype=dtype or like.dtype, device=like.device)

        return Rows(
            room(behaviors.intention.u),
            room(behaviors.satisfaction.u),
            room(learner.trace.u),
            room(learner.opposition.error),
            room(learner.values.weights),
            room(learner.opposition.error),
            room(count),
            room(count, torch.bool),
        )

    def write(
        self, log: Rows, row: Tensor, before: AgentState, after: AgentState, outcome: Outcome
    ) -> Rows:
        """One step into its row, in place: activations as they are, nothing is computed."""
        behaviors, learner = after.behaviors, after.learner
        for rows, value in zip(
            log,
            (
                behaviors.intention.u,
                behaviors.satisfaction.u,
                learner.trace.u,
                learner.opposition.error,
                learner.values.weights,
                outcome.reward,
                outcome.found,
                outcome.completed,
            ),
        ):
            rows.index_copy_(0, row.view(1), value.to(rows.dtype).unsqueeze(0))
        return log

    def collect(self, log: Rows, first: int, steps: int) -> None:
        """Take the ``steps`` rows of a portion that began with step ``first``."""
        nodes = self.behaviors_of
        intention = nodes.intention.output(NodeState(log.intention))
        satisfaction = nodes.satisfaction.output(NodeState(log.satisfaction))
        parts = log._replace(intention=intention, satisfaction=satisfaction)._asdict()
        here, weights = slice(first, first + steps), parts.pop("weights")[:steps]
        for name, rows in parts.items():
            getattr(self, name)[here] = rows[:steps].cpu().numpy()
        sparse = -first % self.SPARSE
        kept = weights[sparse :: self.SPARSE].cpu().numpy()
        place = (first + sparse) // self.SPARSE
        self.weights[place : place + len(kept)] = kept
        before = self.satisfaction[first - 1 : first] if first else 0 * self.satisfaction[:1]
        after = self.satisfaction[here]
        self.reported[here] = reported(np.concatenate((before, after[:-1])), after)
        self.length = first + steps

    # ------------------------------------------------------------------ what it says

    @property
    def behaviors(self) -> np.ndarray:
        """Colours in the order in which the world judged them as found."""
        return self.found[: self.length][self.found[: self.length] != NOTHING]

    @property
    def rewards(self) -> np.ndarray:
        """Steps in which the sequence was completed."""
        return np.flatnonzero(self.completed[: self.length])

    @property
    def disagreements(self) -> int:
        """How often the agent reported another behaviour than the world judged as found.

        The two orders are compared one by one; a last one that the other side has not yet
        noticed does not count.
        """
        reported = self.reported[: self.length]
        reported = reported[reported != NOTHING]
        both = min(len(reported), len(self.behaviors))
        differ = int((reported[:both] != self.behaviors[:both]).sum())
        return differ + max(0, abs(len(reported) - len(self.behaviors)) - 1)

    def optimal(self, period: int) -> bool:
        """Whether its last 40 behaviours brought `enough` rewards, at best one per ``period``."""
        steps = np.flatnonzero(self.found[: self.length] != NOTHING)[-LOOK_BACK:]
        return len(steps) == LOOK_BACK and int(self.completed[steps].sum()) >= enough(period)

    def longest_overlap(self, rates: np.ndarray) -> int:
        """Most steps in a row in which two or more nodes of one kind were on together."""
        together = (is_on(rates[: self.length]).sum(1) > 1).astype(np.int8)
        edges = np.flatnonzero(np.diff(together, prepend=0, append=0))
        return int((edges[1::2] - edges[::2]).max(initial=0))

    @property
    def steps_without_state(self) -> int:
        """Steps after the first completion in which no CoS node was on."""
        on = is_on(self.satisfaction[: self.length]).any(1)
        return int((~on[on.argmax() :]).sum()) if on.any() else 0

"""What happened in a run, step by step."""

import numpy as np
from torch import Tensor

from dntorch.cells.functions import came_on, is_on
from dntorch.envs.task import NOTHING
from dntorch.modules.learner import LearnerState
from dntorch.runs.worlds import Outcome

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


class Record:
    """One row a control step, for an agent of n behaviours without batch.

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
    """

    SPARSE = 100

    def __init__(self, steps: int, n: int) -> None:
        self.length = 0
        self.intention = np.zeros((steps, n), np.float32)
        self.satisfaction = np.zeros((steps, n), np.float32)
        self.trace = np.zeros((steps, n, n), np.float32)
        self.error = np.zeros(steps, np.float32)
        self.reward = np.zeros(steps, np.float32)
        self.found = np.full(steps, NOTHING, np.int8)
        self.completed = np.zeros(steps, np.bool_)
        self.reported = np.full(steps, NOTHING, np.int8)
        self.weights = np.zeros((-(-steps // self.SPARSE), n, n), np.float32)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays, cut to the steps that were recorded."""
        cut = {k: v[: self.length] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return cut | {"weights": self.weights[: -(-self.length // self.SPARSE)]}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Put recorded arrays back at the beginning."""
        self.length = len(arrays["error"])
        for name, array in arrays.items():
            getattr(self, name)[: len(array)] = array

    def write(
        self, intention: Tensor, satisfaction: Tensor, learner: LearnerState, outcome: Outcome
    ) -> None:
        """Append one step: firing rates, the learner's state and what the world answered."""
        t = self.length
        self.intention[t] = intention.numpy()
        self.satisfaction[t] = satisfaction.numpy()
        self.trace[t] = learner.trace.u.numpy()
        self.error[t] = learner.opposition.error
        self.reward[t] = outcome.reward
        self.found[t], self.completed[t] = outcome.found, outcome.completed
        before = self.satisfaction[t - 1] if t else np.zeros_like(self.satisfaction[t])
        self.reported[t] = reported(before, self.satisfaction[t])
        if t % self.SPARSE == 0:
            self.weights[t // self.SPARSE] = learner.values.weights.numpy()
        self.length += 1

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

"""Curiosity about what was not done for long: habituation to behaviours in their context."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.habituation import context_number, freshness, habituation_step
from dntorch.cells.recall import RecallState
from dntorch.checks import check_count, check_ends, check_positive, check_time_constant
from dntorch.dynamics import Dynamics, check_parts
from dntorch.modules.recall import Recall, deepest
from dntorch.number import Number, wide

MOST_CELLS = 1 << 22


class HabituationState(NamedTuple):
    recall: RecallState
    spent: Tensor
    """Share of each transmitter that is spent, ``[context, behaviour]``"""


class Habituation(Dynamics[HabituationState]):
    r"""How fresh each behaviour still is after the last ``order`` completions.

    .. math::
        \dot s_{ci} = \frac{1 - s_{ci}}{\tau_f} C_c I_i - \frac{s_{ci}}{\tau_r}, \qquad
        g_i = \Big(1 - \sum_c C_c s_{ci}\Big)^p

    ================  ==============  ====  ===================================================
    symbol            here            unit  meaning
    ================  ==============  ====  ===================================================
    :math:`s`         ``spent``       1     share of a transmitter that is spent
    :math:`C`         ``context``     1     which context it is: 1 for the last ``order``
                                            completions in their order, else 0
    :math:`I`         ``intention``   1     firing rates of the intentions
    :math:`g`         output          1     how fresh a behaviour is here, 1 if it was never tried
    :math:`\tau_f`    ``fatigue``     s     time constant of the spending, while a behaviour runs
    :math:`\tau_r`    ``recovery``    s     time constant of the recovery
    :math:`p`         ``sharpness``   1     how little one counts that is half recovered
    ================  ==============  ====  ===================================================

    The noise of exploration, multiplied by the output, tries what was not tried in this context,
    one after the other, instead of again and again. A reward for a sequence of L behaviours
    depends on the last L: of ``n * (n - 1) ** (L - 1)`` sequences each behaviour tests one. An
    ``order`` of L - 1 tells them all apart; a smaller one takes some that are new for known, one
    of 0 knows no context at all. No explorer can need less than half of chance's mean.

    Spent transmitters are activation, not long-term memory: ``reset`` makes all fresh. Until
    ``order`` behaviours were completed there is no context, and all are fresh.

    ``fatigue``, ``recovery`` and ``sharpness`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``intention`` and ``satisfaction`` (firing rates) and output (freshness after the step)
    ``(*batch, n)``; ``spent`` has ``n ** order`` times n cells.
    State: ``HabituationState(recall, spent)``, ``spent`` 0 at rest.

    Args:
        n: number of behaviours.
        order: how many completions make a context.
        recall: keeps the completions before the last, ``Recall(n, order - 1)``.

    Raises:
        ValueError: ``dt`` longer than a time constant, ``sharpness`` not positive, more than
            4,194,304 cells, a ``recall`` of another depth.

    Source: the habituative transmitter gate of Grossberg, "How does a brain build a cognitive
    code?", Psychological Review 87, 1980. Not in the paper, which names exploration better than
    chance as future work.

    >>> habituation = Habituation(3, order=1)
    >>> for _ in range(64):  # behaviour 1 runs after behaviour 0 was completed
    ...     fresh = habituation(torch.eye(3)[1], torch.eye(3)[0])
    >>> [round(each, 2) for each in fresh.tolist()]
    [1.0, 0.0, 1.0]
    >>> habituation(torch.zeros(3), torch.eye(3)[2]).tolist()  # after another one it is fresh
    [1.0, 1.0, 1.0]
    """

    spent: Tensor

    def __init__(
        self,
        n: int,
        order: int = 4,
        fatigue: Number = 0.5,
        recovery: Number = 1200.0,
        sharpness: Number = 3.0,
        recall: Recall | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        if order != 0:
            check_count("order", order)
        if n ** (order + 1) > MOST_CELLS:
            raise ValueError(
                f"order={order}: n={n} behaviours would need {n ** (order + 1):,} cells an agent: "
                f"give at most order={deepest(n, MOST_CELLS) - 1}"
            )
        self.n, self.order, self.cells = n, order, n**order
        self.fatigue, self.recovery, self.sharpness = fatigue, recovery, sharpness
        self.recall = recall or Recall(n, max(order - 1, 0), dt=dt)

    def check(self) -> None:
        check_time_constant("fatigue", self.fatigue, self.dt)
        check_time_constant("recovery", self.recovery, self.dt)
        check_positive("sharpness", self.sharpness)
        check_positive("1 / dt - 1 / fatigue - 1 / recovery", self._room(), "take a smaller dt")
        check_parts(self, self.n)
        if self.recall.depth != max(self.order - 1, 0):
            raise ValueError(
                f"recall.depth={self.recall.depth} does not fit order={self.order}: give "
                f"Recall({self.n}, {max(self.order - 1, 0)})"
            )

    def _room(self) -> Number:
        return 1 / self.dt - 1 / self.fatigue - 1 / self.recovery

    def initial(self, batch: list[int]) -> HabituationState:
        cells = batch + [self.cells, self.n]
        return HabituationState(self.recall.initial(batch), self.origin.new_zeros(cells))

    def context(self, satisfaction: Tensor, state: HabituationState) -> Tensor:
        """Number of the context of the last ``order`` completions, -1 for none, ``(*batch,)``."""
        if self.order == 0:
            return torch.zeros_like(satisfaction[..., 0], dtype=torch.int64)
        return context_number(satisfaction, self.recall.output(state.recall))

    def fresh(self, satisfaction: Tensor, state: HabituationState) -> Tensor:
        """How fresh each behaviour is in the present context, ``(*batch, n)``."""
        return freshness(self.context(satisfaction, state), state.spent, wide(self.sharpness, 1))

    def step(
        self, intention: Tensor, satisfaction: Tensor, state: HabituationState
    ) -> tuple[Tensor, HabituationState]:
        state = self.euler(intention, satisfaction, state)
        return self.fresh(satisfaction, state), state

    def euler(
        self, intention: Tensor, satisfaction: Tensor, state: HabituationState
    ) -> HabituationState:
        check_ends("intention", intention, [self.n])
        check_ends("satisfaction", satisfaction, [self.n])
        context = self.context(satisfaction, state)
        numbers = wide(self.fatigue, 1), wide(self.recovery, 2)
        return HabituationState(
            self.recall.euler(satisfaction, state.recall),
            habituation_step(context, intention, state.spent, *numbers, self.dt),
        )

"""Learned constraints: which behaviour is not possible after which."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.constraints import constraint_step
from dntorch.cells.functions import rectified
from dntorch.checks import (
    check_count,
    check_ends,
    check_positive,
    check_states,
    check_time_constant,
)
from dntorch.dynamics import Dynamics
from dntorch.memory import extended
from dntorch.number import Number, span, wide


class ConstraintState(NamedTuple):
    suppression: Tensor
    """``[action, state]``, within 0 and 1, ``(*batch, n, states)``: long-term memory."""


class Constraints(Dynamics[ConstraintState]):
    r"""Weights from states to actions that failures teach and successes unlearn.

    .. math::
        \dot S_{ij} = \eta \big((1 - S_{ij})\, d_i s_j - S_{ij}\, o_{ij} c_i\big)
            - \frac{S_{ij}}{\tau_f}, \qquad
        a_i = \max\Big(1 - \sum_j S_{ij} s_j,\ 10^{-3}\Big), \qquad
        o_{ij} = [-TP_{ij}]_+

    ================  ==================  ====  ===============================================
    symbol            here                unit  meaning
    ================  ==================  ====  ===============================================
    :math:`S`         ``suppression``     1     suppression ``[action, state]``, 0 to 1
    :math:`d`         ``failing``         1     rates of the conditions of dissatisfaction
    :math:`s`         ``context``         1     the state: the behaviour completed last
    :math:`TP`        ``pulse``           1     pulse cells of the learner's pairs; negative when
                                                a pair goes off, counted above ``threshold``
    :math:`c`         ``satisfaction``    1     rates of the conditions of satisfaction
    :math:`a`         `allowed`           1     what is left of each action's share
    :math:`\eta`      ``learning_rate``   1/s   one failure, or success, is enough at 20
    :math:`\tau_f`    ``fade``            s     time constant of forgetting
    ================  ==================  ====  ===============================================

    A failure of behaviour i in state j teaches that i does not follow j; a success in that state
    unlearns it. `allowed` multiplies what an action is worth before the best is given the value 1
    (``available`` of `ValueNodes`), so that the best of those that are left is chosen as surely as
    before. No share is 0: where all are suppressed, the best of them is tried. An action that is
    barred is not tried while another is left, so one that failed by accident comes back when its
    suppression has faded by half.

    ``learning_rate`` and ``fade`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``failing`` and ``satisfaction`` ``(*batch, n)``, ``context`` ``(*batch, states)``,
    ``pulse`` and output (suppression after the step) ``(*batch, n, states)``.
    State: ``ConstraintState(suppression)``, **long-term memory** as in `HebbianQ`.

    Raises:
        ValueError: ``learning_rate`` not positive, or too large for ``dt``; ``dt > fade``.

    Source: the constraints between behaviours of Richter, Sandamirskaya and Schöner 2012, there
    given; learning them is the last sentence of future work of the paper. Not in the paper.

    >>> constraints, none = Constraints(2), torch.zeros(2)
    >>> for _ in range(16):  # behaviour 0 fails after behaviour 1
    ...     learned = constraints(torch.eye(2)[0], torch.eye(2)[1], none, torch.zeros(2, 2))
    >>> learned.round(decimals=2)
    tensor([[0., 1.],
            [0., 0.]])
    """

    lasting = ("suppression",)
    suppression: Tensor
    learning: Tensor

    def __init__(
        self,
        n: int,
        learning_rate: Number = 20.0,
        fade: Number = 1e4,
        threshold: float = 0.05,
        states: int | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.states = n, check_states(n, states)
        self.learning_rate, self.fade, self.threshold = learning_rate, fade, threshold
        self.register_buffer("suppression", torch.zeros(n, self.states))
        self.register_buffer("learning", torch.ones(()), persistent=False)

    def check(self) -> None:
        check_positive("learning_rate", self.learning_rate, "leave the part out to learn nothing")
        check_positive("threshold", self.threshold, "at 0 a pulse never ends")
        check_time_constant("fade", self.fade, self.dt)
        _, fastest = span(self.learning_rate)
        if self.dt * fastest > 1:
            raise ValueError(
                f"learning_rate={fastest} is too large for dt={self.dt}: give at most "
                f"{1 / self.dt:.4g}"
            )

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learning.fill_(float(on))

    def initial(self, batch: list[int]) -> ConstraintState:
        """What has been learned, for each member of ``batch``."""
        return ConstraintState(extended(self.suppression, 2, batch))

    def output(self, state: ConstraintState) -> Tensor:
        return state.suppression.clone()

    def allowed(self, context: Tensor, state: ConstraintState) -> Tensor:
        """What is left of each action's share in this state, ``(*batch, n)``, above 0."""
        return (1 - (state.suppression * context.unsqueeze(-2)).sum(-1)).clamp_min(1e-3)

    def euler(
        self,
        failing: Tensor,
        context: Tensor,
        satisfaction: Tensor,
        pulse: Tensor,
        state: ConstraintState,
    ) -> ConstraintState:
        check_ends("failing", failing, [self.n])
        check_ends("context", context, [self.states])
        check_ends("satisfaction", satisfaction, [self.n])
        check_ends("pulse", pulse, [self.n, self.states])
        offset = rectified(-pulse, self.threshold)
        rates = failing, context, offset, satisfaction
        rate = wide(self.learning_rate, 2) * self.learning
        fade = wide(self.fade, 2)
        return ConstraintState(constraint_step(*rates, state.suppression, rate, fade, self.dt))

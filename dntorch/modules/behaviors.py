"""Elementary behaviours: intentions, and the conditions that satisfy them."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import came_on
from dntorch.cells.node import NodeState
from dntorch.checks import check_count, check_ends, check_positive
from dntorch.dynamics import Dynamics, check_parts
from dntorch.modules.dissatisfaction import Dissatisfaction
from dntorch.modules.node import NodeWTA
from dntorch.number import Number, plus, span, wide


class BehaviorState(NamedTuple):
    intention: NodeState
    satisfaction: NodeState
    dissatisfaction: dict[str, Tensor]
    """Of the part by name; empty without one."""


class ElementaryBehaviors(Dynamics[BehaviorState]):
    r"""n behaviours, each an intention node and a condition-of-satisfaction (CoS) node.

    .. math::
        \tau \dot d_i^{int} &= -d_i^{int} + h + c_+ f(d_i^{int})
            - c_- \sum_{k \neq i} f(d_k^{int}) + c_{val} d_i^{val} - c_{cos} f(d_i^{cos}) \\
        \tau \dot d_i^{cos} &= -d_i^{cos} + h + c_+ f(d_i^{cos})
            - c_- \sum_{k \neq i} f(d_k^{cos}) - c_{int} \sum_{k \neq i} f(d_k^{int}) + c_{in} m_i

    ===================  ===================  ====  =============================================
    symbol               here                 unit  meaning
    ===================  ===================  ====  =============================================
    :math:`d^{int}`      ``intention``        1     intention nodes, a `NodeWTA`
    :math:`d^{cos}`      ``satisfaction``     1     CoS nodes, a `NodeWTA`
    :math:`d^{val}`      ``value``            1     value nodes, 1 for the best action
    :math:`m`            ``match``            1     0 to 1: percept fits the CoS of behaviour i
    :math:`c_{val}`      ``value_gain``       1     values drive intentions
    :math:`c_{cos}`      ``completion_gain``  1     the own CoS ends an intention
    :math:`c_{int}`      ``intention_gain``   1     other intentions weaken a CoS
    :math:`c_{in}`       ``match_gain``       1     percepts drive the CoS
    ===================  ===================  ====  =============================================

    The CoS node of the last completed behaviour stays on by itself, as the *state*, until
    the next CoS switches it off: exactly one is on after the first.

    The four gains may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``value`` and ``match`` ``(*batch, n)``; output ``(intention, satisfaction)``, the
    firing rates after the step, ``(*batch, n)`` each.
    State: ``BehaviorState(intention, satisfaction, dissatisfaction)``, at their resting levels.

    Args:
        n: number of behaviours.
        intention, satisfaction: nodes with other parameters than the defaults.
        dissatisfaction: condition-of-dissatisfaction (CoD) nodes, which end an intention that was
            on too long as a CoS ends one that succeeded, with the same gain. None: it may wait for
            ever.

    Raises:
        ValueError: ``n < 2``, gains that are not positive, nodes of another number or ``dt``.

    Source: eqs. (2) and (3) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics"; Richter, Sandamirskaya and
    Schöner 2012 for the memory of completion.

    **Deviations** (printed, used, why):

    * :math:`c_{val} = 20`, 10 for any n, since the best action has the value 1: two that are
      nearly alike come on together the less, the slower they rise.
    * :math:`c_{cos} = 5`, 20: with 5 the finished intention stays on until the next one ends
      it; to end it by itself the inhibition must exceed the largest value input and the
      self-excitation together.
    * :math:`c_-^{int} = 10`, 30: two intentions that start together stay on together.
    * no inhibition among CoS nodes, 8, and :math:`c_+^{cos}` = 8 (not given): the state must
      persist while the next behaviour runs, or the temporal difference has no old pair.
    * no floor, -12 under the intentions: without it the one before last, whose CoS inhibited
      it until now, starts later than the others and returns are too rare. An intention that
      is on, and a finished one's CoS, push all others to the floor: they start level.
    """

    def __init__(
        self,
        n: int,
        intention: NodeWTA | None = None,
        satisfaction: NodeWTA | None = None,
        dissatisfaction: Dissatisfaction | None = None,
        value_gain: Number = 10.0,
        completion_gain: Number | None = None,
        intention_gain: Number = 2.0,
        match_gain: Number = 15.0,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.value_gain = n, value_gain
        if completion_gain is None:
            held = self.value_gain
            completion_gain = 2 * (held.detach() if isinstance(held, Tensor) else held)
        self.completion_gain = completion_gain
        self.intention_gain, self.match_gain = intention_gain, match_gain
        inhibition = span(self.value_gain)[1] + 20  # two that are on end each other
        self.intention = intention or NodeWTA(n, inhibition=inhibition, floor=-12.0, dt=dt)
        self.satisfaction = satisfaction or NodeWTA(n, excitation=8.0, inhibition=8.0, dt=dt)
        self.dissatisfaction = dissatisfaction

    def check(self) -> None:
        for name in ("value_gain", "completion_gain", "match_gain"):
            check_positive(name, getattr(self, name))
        check_parts(self, self.n)

    def output(self, state: BehaviorState) -> tuple[Tensor, Tensor]:
        """Firing rates of intention and CoS nodes."""
        return (
            self.intention.output(state.intention),
            self.satisfaction.output(state.satisfaction),
        )

    def failing(self, state: BehaviorState) -> Tensor:
        """Firing rates of the CoD nodes, ``(*batch, n)``; 0 without such nodes."""
        if self.dissatisfaction is None:
            return torch.zeros_like(state.intention.u)
        return self.dissatisfaction.output(self.dissatisfaction.nested(state.dissatisfaction))

    def failed(self, before: BehaviorState, after: BehaviorState) -> Tensor:
        """Whether a CoD node came on between two states, ``(*batch,)``."""
        return came_on(self.failing(before), self.failing(after)).any(-1)

    def euler(self, value: Tensor, match: Tensor, state: BehaviorState) -> BehaviorState:
        return self.relax(value, match, self.output(state), state)

    def relax(
        self, value: Tensor, match: Tensor, output: tuple[Tensor, Tensor], state: BehaviorState
    ) -> BehaviorState:
        """`euler` for a composite that knows the output already."""
        check_ends("value", value, [self.n])
        check_ends("match", match, [self.n])
        intention, satisfaction = output
        others = intention.sum(-1, keepdim=True) - intention
        drive = plus(wide(self.value_gain, 1) * value, -wide(self.completion_gain, 1), satisfaction)
        percept = plus(wide(self.match_gain, 1) * match, -wide(self.intention_gain, 1), others)
        waiting = state.dissatisfaction
        if self.dissatisfaction is not None:
            drive = plus(drive, -wide(self.completion_gain, 1), self.failing(state))
            inner = self.dissatisfaction.nested(waiting)
            waiting = self.dissatisfaction.flat(self.dissatisfaction.euler(intention, inner))
        return BehaviorState(
            self.intention.relax(drive, intention, state.intention),
            self.satisfaction.relax(percept, satisfaction, state.satisfaction),
            waiting,
        )

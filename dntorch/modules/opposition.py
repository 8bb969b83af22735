"""The temporal-difference error as a field of opposed values."""

from torch import Tensor

from dntorch.cells.opposition import OppositionState, opposition_step
from dntorch.checks import (
    check_count,
    check_ends,
    check_positive,
    check_states,
    check_time_constant,
)
from dntorch.dynamics import Dynamics
from dntorch.number import Number, span, wide


class ValueOpposition(Dynamics[OppositionState]):
    r"""Value opposition field and value cell: v goes to :math:`\gamma Q(s',a') - Q(s,a)`.

    .. math::
        \tau_O \dot O_{ij} &= -O_{ij} + f_H(u_{ij} - \theta_u) W_{ij}
            \big(\gamma f_H(TP^+_{ij} - \theta) - f_H(-TP^+_{ij} - \theta)\big) \\
        \tau_v \dot v &= -v + \sum_{ij} O_{ij}

    ================  ====================  ====  ==============================================
    symbol            here                  unit  meaning
    ================  ====================  ====  ==============================================
    :math:`O`         ``opposition``        1     value opposition field
    :math:`v`         ``error``             1     value cell: TD error without the reward
    :math:`TP^+`      ``pulse``             1     positive for the new pair, negative for the old
    :math:`u`         ``trace``             1     eligibility trace
    :math:`W`         ``weights``           1     action values ``[action, state]``
    :math:`\gamma`    ``discount``          1     discount factor
    :math:`\tau_O`    ``tau``               s     time constant of the field
    :math:`\tau_v`    ``tau_error``         s     time constant of the value cell
    :math:`\theta`    ``pulse_threshold``   1     above it a pulse counts: sets its width in time
    :math:`\theta_u`  ``trace_threshold``   1     above it a pair counts as remembered
    ================  ====================  ====  ==============================================

    All numbers may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``pulse``, ``trace``, ``weights`` ``(*batch, n, states)``, output (v after the step)
    ``(*batch,)``; ``states`` is n unless given.
    State: ``OppositionState(opposition, error)``, 0 at rest.

    Raises:
        ValueError: ``dt`` longer than a time constant, ``discount`` outside [0, 1], a
            threshold that is not positive.

    Source: eqs. (10) and (11) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviations**: printed :math:`f_H(TP^+)` and :math:`f_H(u)`; both get a threshold, since
    a pulse :math:`(t/\tau)e^{-t/\tau}` and a decaying trace are positive for ever and a
    "pulse of fixed width" would never end. Printed :math:`W_{vu}` lost its index, and the
    equation a parenthesis. :math:`\tau^v` is not given; here .1 s as :math:`\tau^O`.

    >>> cell, weights = ValueOpposition(2), torch.tensor([[0.0, 1.0], [0.5, 0.0]])
    >>> pulse = torch.tensor([[0.0, 0.3], [-0.3, 0.0]])  # pair (0, 1) on, pair (1, 0) off
    >>> for _ in range(64):
    ...     error = cell(pulse, torch.ones(2, 2), weights)
    >>> round(float(error), 3)  # 0.8 * 1 - 0.5
    0.3
    """

    opposition: Tensor
    error: Tensor

    def __init__(
        self,
        n: int,
        discount: Number = 0.8,
        tau: Number = 0.1,
        tau_error: Number = 0.1,
        pulse_threshold: Number = 0.05,
        trace_threshold: Number = 0.01,
        states: int | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.states = check_states(n, states)
        self.n, self.discount = n, discount
        self.tau, self.tau_error = tau, tau_error
        self.pulse_threshold, self.trace_threshold = pulse_threshold, trace_threshold

    def check(self) -> None:
        check_time_constant("tau", self.tau, self.dt)
        check_time_constant("tau_error", self.tau_error, self.dt)
        low, high = span(self.discount)
        if not 0 <= low <= high <= 1:
            raise ValueError(f"discount={low if low < 0 else high}: give a number from 0 to 1")
        check_positive("pulse_threshold", self.pulse_threshold, "at 0 a pulse never ends")
        check_positive("trace_threshold", self.trace_threshold, "at 0 a pulse never ends")

    def initial(self, batch: list[int]) -> OppositionState:
        return OppositionState(
            self.origin.new_zeros(batch + [self.n, self.states]),
            self.origin.new_zeros(batch),
        )

    def output(self, state: OppositionState) -> Tensor:
        return state.error.clone()

    def euler(
        self, pulse: Tensor, trace: Tensor, weights: Tensor, state: OppositionState
    ) -> OppositionState:
        check_ends("pulse", pulse, [self.n, self.states])
        check_ends("trace", trace, [self.n, self.states])
        check_ends("weights", weights, [self.n, self.states])
        thresholds = wide(self.pulse_threshold, 2), wide(self.trace_threshold, 2)
        numbers = wide(self.discount, 2), wide(self.tau, 2), self.tau_error
        return opposition_step(pulse, trace, weights, state, *numbers, *thresholds, self.dt)

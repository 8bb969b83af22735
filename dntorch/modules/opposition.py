"""The temporal-difference error as a field of opposed values."""

from torch import Tensor

from dntorch.cells.opposition import OppositionState, opposition_step
from dntorch.dynamics import Dynamics, check_ends, check_time_constant, overwrite


class ValueOpposition(Dynamics):
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

    Shapes: ``pulse``, ``trace``, ``weights`` ``(*batch, n, n)``, output (v after the step)
    ``(*batch,)``. State: ``OppositionState(opposition, error)``, 0 at rest.

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
        discount: float = 0.8,
        tau: float = 0.1,
        tau_error: float = 0.1,
        pulse_threshold: float = 0.05,
        trace_threshold: float = 0.01,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_time_constant("tau", tau, dt)
        check_time_constant("tau_error", tau_error, dt)
        if not 0 <= discount <= 1:
            raise ValueError(f"discount={discount}: give a number from 0 to 1")
        for name, threshold in (("pulse", pulse_threshold), ("trace", trace_threshold)):
            if not threshold > 0:
                raise ValueError(
                    f"{name}_threshold={threshold} must be positive: at 0 a pulse never ends"
                )
        self.n, self.discount = n, discount
        self.tau, self.tau_error = tau, tau_error
        self.pulse_threshold, self.trace_threshold = pulse_threshold, trace_threshold
        self.resize()

    @property
    def state(self) -> OppositionState:
        return OppositionState(self.opposition.clone(), self.error.clone())

    @state.setter
    def state(self, state: OppositionState) -> None:
        overwrite(self.opposition, state.opposition)
        overwrite(self.error, state.error)

    def initial(self, batch: list[int]) -> OppositionState:
        return OppositionState(
            self.origin.new_zeros(batch + [self.n, self.n]),
            self.origin.new_zeros(batch),
        )

    def forward(self, pulse: Tensor, trace: Tensor, weights: Tensor) -> Tensor:
        output, self.state = self.step(pulse, trace, weights, self.state)
        return output

    def step(
        self, pulse: Tensor, trace: Tensor, weights: Tensor, state: OppositionState
    ) -> tuple[Tensor, OppositionState]:
        check_ends("pulse", pulse, [self.n, self.n])
        check_ends("trace", trace, [self.n, self.n])
        check_ends("weights", weights, [self.n, self.n])
        state = opposition_step(
            pulse, trace, weights, state, self.discount, self.tau, self.tau_error,
            self.pulse_threshold, self.trace_threshold, self.dt,
        )  # fmt: skip
        return state.error, state

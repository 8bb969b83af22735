"""Working memory that keeps items and their order."""

from torch import Tensor

from dntorch.cells.working_memory import WorkingMemoryState, working_memory_step
from dntorch.checks import (
    check_count,
    check_ends,
    check_positive,
    check_states,
    check_time_constant,
)
from dntorch.dynamics import Dynamics
from dntorch.number import Number, span, wide


class ItemOrderWM(Dynamics[WorkingMemoryState]):
    r"""Item-and-order working memory over pairs: the eligibility trace.

    .. math:: \tau \dot u_{ij} = (1-u_{ij})\big(\alpha f_P(TP^+_{ij}) + \beta u_{ij}\big)
              - u_{ij} \sum_{kl \neq ij} \big(\alpha f_P(TP^+_{kl}) + \beta u_{kl}\big)

    ==============  ==============  ====  ================================================
    symbol          here            unit  meaning
    ==============  ==============  ====  ================================================
    :math:`u`       ``u``           1     activity, stays within 0 and 1
    :math:`\tau`    ``tau``         s     time constant; sets how much of the past survives
    :math:`\alpha`  ``excitation``  1     gain of the pulses
    :math:`\beta`   ``feedback``    1     recurrent gain; brings the sum of activity to 1
    :math:`f_P`     ``threshold``   1     pulses count above it, with their own size
    ==============  ==============  ====  ================================================

    Between pulses every ratio of activities is conserved and their sum goes to 1: a level
    lasts as long as a behaviour does, whatever that is. A pulse of area A into one cell of
    a settled memory multiplies all others by :math:`e^{-\alpha A / \tau}`: an accumulating
    trace with that decay per transition (:math:`\gamma\lambda` of SARSA(:math:`\lambda`)).

    ``tau``, ``excitation`` and ``feedback`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: input (pulses) and output (activity after the step) ``(*batch, n, states)``; ``states``
    is n unless given.
    State: ``WorkingMemoryState(u)``, 0 at rest, which is a fixed point.

    Raises:
        ValueError: ``dt > tau``, or so coarse a step that activity could leave [0, 1]; a
            gain or threshold below 0.

    Source: eq. (9) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics"; Grossberg 1978.

    **Deviations**: :math:`\tau^u` and :math:`f_P` are not given in the paper; here 1 s and
    "the pulse itself above a threshold, else 0". Where pulses are so strong that a step would
    overshoot, the step is shortened, so that activity stays within 0 and 1 for any pulse. The
    background section prints the update of pairs t steps back as
    :math:`\gamma^t \lambda \delta`; the trace of SARSA(:math:`\lambda`), and the one that this
    memory makes, is :math:`(\gamma\lambda)^t \delta`.

    >>> memory = ItemOrderWM(2)
    >>> for site in [(0, 1), (1, 0)]:  # two pulses, one after the other
    ...     for step in range(96):
    ...         pulse = torch.zeros(2, 2)
    ...         pulse[site] = float(step < 32)
    ...         trace = memory(pulse)
    >>> bool(trace[1, 0] > trace[0, 1] > 0)  # the later one is the stronger
    True
    """

    u: Tensor

    def __init__(
        self,
        n: int,
        tau: Number = 1.0,
        excitation: Number = 1.1,
        feedback: Number = 0.8,
        threshold: float = 0.05,
        states: int | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.states = check_states(n, states)
        self.n, self.tau, self.threshold = n, tau, threshold
        self.excitation, self.feedback = excitation, feedback

    def check(self) -> None:
        check_time_constant("tau", self.tau, self.dt)
        check_positive("excitation", self.excitation)
        for name in ("feedback", "threshold"):
            low, _ = span(getattr(self, name))
            if low < 0:
                raise ValueError(f"{name}={low}: give 0 or more, or activity could leave [0, 1]")
        _, gain = span((self.excitation + self.feedback) / self.tau)
        if self.dt * gain > 1:
            raise ValueError(
                f"dt={self.dt} with tau={span(self.tau)[0]}: activity could leave [0, 1]; take "
                f"dt <= {1 / gain:.4g}, or less excitation and feedback"
            )

    def initial(self, batch: list[int]) -> WorkingMemoryState:
        return WorkingMemoryState(self.origin.new_zeros(batch + [self.n, self.states]))

    def output(self, state: WorkingMemoryState) -> Tensor:
        return state.u.clone()

    def euler(self, input: Tensor, state: WorkingMemoryState) -> WorkingMemoryState:
        check_ends("input", input, [self.n, self.states])
        tau, excitation, feedback = (
            wide(self.tau, 2),
            wide(self.excitation, 2),
            wide(self.feedback, 2),
        )
        return working_memory_step(input, state, tau, excitation, feedback, self.threshold, self.dt)

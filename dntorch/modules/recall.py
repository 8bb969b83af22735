"""Memory of the completions before the last one."""

from torch import Tensor

from dntorch.cells.functions import abs_sigmoid
from dntorch.cells.recall import RecallState, conjunctions, recall_step
from dntorch.checks import (
    check_count,
    check_ends,
    check_negative,
    check_positive,
    check_time_constant,
)
from dntorch.dynamics import Dynamics
from dntorch.number import Number, wide

MOST_STATES = 1 << 22


class Recall(Dynamics[RecallState]):
    r"""Nodes for the behaviour that was completed before the last one, and for those before it.

    .. math::
        \tau \dot u_{ki} = -u_{ki} + h + c_+ f(u_{ki}) - c_- \sum_{l \neq i} f(u_{kl})
            + c_p f_H(-TP^+_{k-1,i} - \theta)

    =====================  ===================  ====  =========================================
    symbol                 here                 unit  meaning
    =====================  ===================  ====  =========================================
    :math:`u`              ``u``                1     nodes of ``depth`` levels, n each
    :math:`TP^+_{k-1}`     ``pulse``            1     transient pulse cells (`TPCell`) of the
                                                      level below; level 0 is the CoS nodes
    :math:`\tau`           ``tau``              s     time constant of the nodes
    :math:`\tau_p`         ``tau_pulse``        s     time constant of the pulse cells
    :math:`h`              ``h``                1     resting level, negative
    :math:`c_+`            ``excitation``       1     self-excitation; above ``-h``: they stay on
    :math:`c_-`            ``inhibition``       1     mutual inhibition within a level
    :math:`c_p`            ``pulse_gain``       1     the offset of a node switches the next level
    :math:`\theta`         ``pulse_threshold``  1     of the pulses
    =====================  ===================  ====  =========================================

    When a behaviour is completed, its CoS node switches that of the one before off. That offset
    switches the node of level 1 on, which switches another off, and so on: each level keeps what
    the level below has given up.

    A *context* is the conjunction of the last completion and the recalled ones, the state that a
    ``Learner(n, states=recall.states)`` pairs with actions. There is none until ``depth + 1``
    behaviours were completed.

    The numbers but ``pulse_threshold`` may be tensors ``(*batch,)``, one per agent.

    Shapes: input (firing rates of the CoS nodes) ``(*batch, n)``; output (those of the nodes after
    the step) ``(*batch, depth, n)``; ``context(satisfaction, output)`` ``(*batch, states)``,
    ``states = n ** (depth + 1)``, the last completion counting first.
    State: ``RecallState(u, pulse, inhibitory)``, nodes at ``h`` and pulses at 0 at rest.

    Args:
        n: number of behaviours.
        depth: how many completions before the last one are kept.

    Raises:
        ValueError: ``dt`` longer than a time constant, nodes that would not stay on, more than
            4,194,304 states.

    Not in the paper, whose state is the last completion; the detector is its own, eqs. (7) and
    (8) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous Reinforcement of Behavioral
    Sequences in Neural Dynamics".

    >>> recall = Recall(3)
    >>> for done in (2, 0, 1):  # completed one after the other
    ...     for _ in range(64):
    ...         recalled = recall(torch.eye(3)[done])
    >>> (recalled > 0.5).tolist()
    [[True, False, False]]
    """

    def __init__(
        self,
        n: int,
        depth: int = 1,
        tau: Number = 0.05,
        tau_pulse: Number = 0.1,
        h: Number = -5.0,
        excitation: Number = 8.0,
        inhibition: Number = 8.0,
        pulse_gain: Number = 30.0,
        pulse_threshold: float = 0.05,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        if depth != 0:  # a context of the last completion alone
            check_count("depth", depth)
        if n ** (depth + 1) > MOST_STATES:
            raise ValueError(
                f"depth={depth}: {n ** (depth + 1):,} states of n={n} are too many: give at most "
                f"{deepest(n, MOST_STATES) - 1}"
            )
        self.n, self.depth, self.states = n, depth, n ** (depth + 1)
        self.tau, self.tau_pulse, self.h = tau, tau_pulse, h
        self.excitation, self.inhibition = excitation, inhibition
        self.pulse_gain, self.pulse_threshold = pulse_gain, pulse_threshold

    def check(self) -> None:
        check_negative("h", self.h, "with another every node is on at rest")
        check_time_constant("tau", self.tau, self.dt)
        check_time_constant("tau_pulse", self.tau_pulse, self.dt)
        check_positive("pulse_threshold", self.pulse_threshold, "at 0 a pulse never ends")
        check_positive(
            "excitation + h", self.excitation + self.h, "or nodes go off when their pulse ends"
        )
        drive = self.pulse_gain - self.inhibition + self.h
        check_positive("pulse_gain - inhibition + h", drive, "give more pulse_gain")

    def initial(self, batch: list[int]) -> RecallState:
        zero = self.origin.new_zeros(batch + [self.depth, self.n])
        return RecallState(zero + wide(self.h, 2), zero.clone(), zero.clone())

    def output(self, state: RecallState) -> Tensor:
        return abs_sigmoid(state.u, 100.0, 0.0)

    def context(self, satisfaction: Tensor, output: Tensor) -> Tensor:
        """Rate of each state, ``(*batch, states)``; `conjunctions` says which is which."""
        return conjunctions(satisfaction, output)

    def euler(self, satisfaction: Tensor, state: RecallState) -> RecallState:
        check_ends("satisfaction", satisfaction, [self.n])
        return self.relax(satisfaction, self.output(state), state)

    def relax(self, satisfaction: Tensor, output: Tensor, state: RecallState) -> RecallState:
        """`euler` for a composite that knows the output already."""
        given, batch = list(satisfaction.shape[:-1]), list(output.shape[:-2])
        if given != batch:
            raise ValueError(
                f"satisfaction of batch {given} does not fit the batch {batch}: call "
                "resize(*batch) with the batch of the inputs first"
            )
        gains = wide(self.h, 2), wide(self.excitation, 2), wide(self.inhibition, 2)
        pulses = wide(self.pulse_gain, 2), self.pulse_threshold
        taus = wide(self.tau, 2), wide(self.tau_pulse, 2)
        return recall_step(satisfaction, output, state, *taus, *gains, *pulses, self.dt)


def deepest(n: int, most: int) -> int:
    """The largest whole number k for which ``n ** k`` is at most ``most``."""
    k = 0
    while n ** (k + 1) <= most:
        k += 1
    return k

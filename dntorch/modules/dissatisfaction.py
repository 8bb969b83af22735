"""The condition of dissatisfaction: ends an intention that cannot be fulfilled."""

from torch import Tensor

from dntorch.cells.dissatisfaction import DissatisfactionState, dissatisfaction_step
from dntorch.cells.functions import abs_sigmoid, rectified
from dntorch.checks import (
    check_count,
    check_ends,
    check_negative,
    check_positive,
    check_time_constant,
)
from dntorch.dynamics import Dynamics
from dntorch.number import Number, wide


class Dissatisfaction(Dynamics[DissatisfactionState]):
    r"""Nodes that come on when an intention was on for ``patience`` seconds without success.

    .. math::
        \dot x_i &= \frac{I_i}{T} - \frac{(1 - I_i)\, x_i}{\tau_x} \\
        \tau \dot u_i &= -u_i + h + c_{in} f_H(x_i - 1)

    ================  =============  ====  ====================================================
    symbol            here           unit  meaning
    ================  =============  ====  ====================================================
    :math:`I`         ``intention``  1     firing rates of the intentions
    :math:`x`         ``waited``     1     how long it has been on, as a share of the patience
    :math:`u`         ``u``          1     condition-of-dissatisfaction (CoD) nodes
    :math:`T`         ``patience``   s     how long an intention may be on
    :math:`\tau_x`    ``release``    s     time constant with which the waiting is forgotten
    :math:`\tau`      ``tau``        s     time constant of the nodes
    :math:`h`         ``h``          1     resting level, negative
    :math:`c_{in}`    ``gain``       1     drives a node whose time is over
    ================  =============  ====  ====================================================

    The waiting counts up to twice the patience. The node inhibits its intention
    (`ElementaryBehaviors`), so that the waiting is forgotten and the node goes off again, a third
    of a second later.

    The numbers may be tensors ``(*batch,)``, one per agent.

    Shapes: input and output (firing rates of the nodes after the step) ``(*batch, n)``.
    State: ``DissatisfactionState(waited, u)``, 0 and ``h`` at rest.

    Raises:
        ValueError: ``dt`` longer than a time constant, ``gain`` too small to bring a node on.

    Source: the condition of dissatisfaction of Richter, Sandamirskaya and Schöner, "A robotic
    architecture for action selection and behavioral organization inspired by human cognition",
    2012. Not in the paper, whose agent waits for ever.

    >>> nodes = Dissatisfaction(2, patience=1.0)
    >>> sum(bool(nodes(torch.tensor([1.0, 0.0]))[0] < 0.5) for _ in range(64))  # steps of 1/32 s
    36
    """

    def __init__(
        self,
        n: int,
        patience: Number = 20.0,
        release: Number = 0.1,
        tau: Number = 0.3,
        h: Number = -5.0,
        gain: Number = 15.0,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.patience, self.release = n, patience, release
        self.tau, self.h, self.gain = tau, h, gain

    def check(self) -> None:
        check_negative("h", self.h, "with another every node is on at rest")
        for name in ("patience", "release", "tau"):
            check_time_constant(name, getattr(self, name), self.dt)
        check_positive("gain + h", self.gain + self.h, "give more gain, or no node comes on")

    def initial(self, batch: list[int]) -> DissatisfactionState:
        zero = self.origin.new_zeros(batch + [self.n])
        return DissatisfactionState(zero, zero + wide(self.h, 1))

    def output(self, state: DissatisfactionState) -> Tensor:
        """Firing rate of the nodes, 0 below 1/2: the tails of resting ones would be failures."""
        return rectified(abs_sigmoid(state.u, 100.0, 0.0), 0.5)

    def euler(self, intention: Tensor, state: DissatisfactionState) -> DissatisfactionState:
        check_ends("intention", intention, [self.n])
        times = wide(self.patience, 1), wide(self.release, 1), wide(self.tau, 1)
        gains = wide(self.h, 1), wide(self.gain, 1)
        return dissatisfaction_step(intention, state, *times, *gains, self.dt)

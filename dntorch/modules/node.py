"""Nodes that compete until one wins."""

from torch import Tensor

from dntorch.cells.functions import abs_sigmoid
from dntorch.cells.node import NodeState, floored, node_target
from dntorch.checks import check_count, check_ends, check_negative, check_time_constant
from dntorch.dynamics import Dynamics
from dntorch.number import Number, span, wide


class NodeWTA(Dynamics[NodeState]):
    r"""Neural nodes with self-excitation and mutual inhibition.

    .. math:: \tau \dot u_i = -u_i + h + c_+ f_S(u_i) - c_- \sum_{k \neq i} f_S(u_k) + S_i

    ============  ==============  ========  ==========================================
    symbol        here            unit      meaning
    ============  ==============  ========  ==========================================
    :math:`u`     ``u``           1         activation; a node is *on* above ``threshold``
    :math:`\tau`  ``tau``         s         time constant
    :math:`h`     ``h``           1         resting level, negative
    :math:`c_+`   ``excitation``  1         self-excitation; above ``-h`` a node stays on
                                            without input
    :math:`c_-`   ``inhibition``  1         mutual inhibition, a positive number
    :math:`\beta` ``steepness``   1         of the sigmoid
    :math:`\mu`   ``threshold``   1         of the sigmoid
    ..            ``floor``       1         :math:`u` never falls below it; ``None``: no floor
    ============  ==============  ========  ==========================================

    ``tau``, ``h``, ``excitation`` and ``inhibition`` may be tensors ``(*batch,)``, one number per
    agent.

    Shapes: input and output ``(*batch, n)``; the output is :math:`f_S(u)` after the step.
    State: ``NodeState(u)``, at rest ``h``.

    Raises:
        ValueError: ``n < 1``, ``dt > tau``, ``h`` not negative, ``floor`` above ``h``.

    Source: eqs. (2) and (3) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviations**: printed :math:`h = 5`, used -5 (the text says h < 0; with +5 every node
    is on at rest). Printed :math:`c_- = c_+ = 10`; the default is 30, since at 10 two nodes
    that cross threshold together stay on together. The floor is not in the paper: with it a
    node that was inhibited strongly comes back as soon as one that was inhibited a little.

    >>> nodes = NodeWTA(3)
    >>> for _ in range(64):
    ...     output = nodes(torch.tensor([6.0, 7.0, 6.5]))
    >>> (output > 0.5).tolist()
    [False, True, False]
    """

    u: Tensor

    def __init__(
        self,
        n: int,
        tau: Number = 0.3,
        h: Number = -5.0,
        excitation: Number = 10.0,
        inhibition: Number = 30.0,
        steepness: float = 100.0,
        threshold: float = 0.0,
        floor: float | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 1)
        self.n, self.tau, self.h = n, tau, h
        self.excitation, self.inhibition = excitation, inhibition
        self.steepness, self.threshold, self.floor = steepness, threshold, floor

    def check(self) -> None:
        check_negative("h", self.h, "with another every node is on at rest")
        check_time_constant("tau", self.tau, self.dt)
        if self.floor is not None and self.floor > span(self.h)[0]:
            raise ValueError(f"floor={self.floor} is above h={span(self.h)[0]}: give less than h")

    def initial(self, batch: list[int]) -> NodeState:
        rest = self.origin.new_zeros(batch + [self.n])
        return NodeState(rest + wide(self.h, 1))

    def output(self, state: NodeState) -> Tensor:
        """Firing rate :math:`f_S(u)`."""
        return abs_sigmoid(state.u, self.steepness, self.threshold)

    def euler(self, input: Tensor, state: NodeState) -> NodeState:
        check_ends("input", input, [self.n])
        return self.relax(input, self.output(state), state)

    def relax(self, input: Tensor, output: Tensor, state: NodeState) -> NodeState:
        """`euler` for a composite that knows the output already, and the shape of the input."""
        gains = wide(self.h, 1), wide(self.excitation, 1), wide(self.inhibition, 1)
        target = node_target(input, output, *gains)
        return NodeState(floored(state.u.lerp(target, self.dt / wide(self.tau, 1)), self.floor))

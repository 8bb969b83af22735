"""Value nodes: what the learned values suggest to do next."""

import torch
from torch import Tensor

from dntorch.cells.value import ValueState, value_step
from dntorch.checks import check_count, check_ends, check_positive, check_time_constant
from dntorch.dynamics import Dynamics
from dntorch.number import Number, wide


class ValueNodes(Dynamics[ValueState]):
    r"""Nodes that read the values of the current state, normalised to a sum of one.

    .. math:: \tau \dot d_i = -d_i + \frac{x_i}{\sum_k x_k}, \qquad
              x_i = \Big[\sum_{j \neq i} W_{ij} s_j\Big]_+ + b_i (1 - s_i)

    ===================  ================  ====  =============================================
    symbol               here              unit  meaning
    ===================  ================  ====  =============================================
    :math:`d`            ``value``         1     activation of the value nodes
    :math:`s`            ``satisfaction``  1     the state: 1 for CoS nodes with an output
                                                 above 1/2, else 0
    :math:`W`            ``weights``       1     values ``[action, state]``, noise included
    :math:`\tau`         ``tau``           s     time constant
    :math:`b`            ``baseline``      1     innate preference, small: decides where
                                                 nothing has been learned
    ===================  ================  ====  =============================================

    ``tau`` and ``baseline`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``satisfaction`` and output (activation after the step) ``(*batch, n)``,
    ``weights`` ``(*batch, n, n)`` or ``(n, n)``. State: ``ValueState(value)``, 0 at rest.

    Raises:
        ValueError: ``dt > tau``, ``baseline`` not positive, ``n < 2``.

    Source: eq. (5) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviations**: printed without the leak :math:`-d_i`, but a pure integrator diverges; the
    text normalises afterwards, here the input is normalised and the nodes relax to it.
    Printed for positive W only: with all W zero the normalisation is 0/0 and W may become
    negative, so the sum is rectified and ``baseline`` keeps it positive. The preference
    grows slightly with i, since equal nodes never decide without noise. The finished
    behaviour has no share, neither by the diagonal of W nor by preference: it may not win
    again, and what it took could leave the others below threshold for ever. The output
    :math:`f` is not given: with :math:`f_S` the tails of resting nodes add up to a state.

    >>> nodes = ValueNodes(3)
    >>> weights = torch.tensor([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.2, 0.0, 0.0]])
    >>> for _ in range(32):
    ...     value = nodes(torch.tensor([1.0, 0.0, 0.0]), weights)  # in state 0
    >>> [round(share, 3) for share in value.tolist()]
    [0.0, 0.749, 0.251]
    """

    value: Tensor
    ladder: Tensor
    off_diagonal: Tensor

    def __init__(
        self, n: int, tau: Number = 0.1, baseline: Number = 1e-3, dt: float = 1 / 32
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.tau, self.baseline = n, tau, baseline
        self.register_buffer("ladder", 1 + torch.arange(n) / n, persistent=False)
        self.register_buffer("off_diagonal", 1 - torch.eye(n), persistent=False)

    def check(self) -> None:
        check_time_constant("tau", self.tau, self.dt)
        check_positive("baseline", self.baseline, "at 0 the values may sum to 0")

    def initial(self, batch: list[int]) -> ValueState:
        return ValueState(self.origin.new_zeros(batch + [self.n]))

    def output(self, state: ValueState) -> Tensor:
        return state.value.clone()

    def euler(self, satisfaction: Tensor, weights: Tensor, state: ValueState) -> ValueState:
        check_ends("satisfaction", satisfaction, [self.n])
        check_ends("weights", weights, [self.n, self.n])
        weights = weights * self.off_diagonal
        preference = self.ladder * wide(self.baseline, 1)
        return value_step(satisfaction, weights, state, preference, wide(self.tau, 1), self.dt)

"""Value nodes: what the learned values suggest to do next."""

import torch
from torch import Tensor

from dntorch.cells.value import ValueState, value_step
from dntorch.checks import check_count, check_ends, check_positive, check_time_constant
from dntorch.dynamics import Dynamics
from dntorch.number import Number, wide


class ValueNodes(Dynamics[ValueState]):
    r"""Nodes that read the values of the current state, relative to the best action.

    .. math:: \tau \dot d_i = -d_i + \Big(\frac{x_i}{\max_k x_k}\Big)^p, \qquad
              x_i = \Big(\Big[\sum_j W_{ij} s_j + \xi_i\Big]_+ + b_i\Big) a_i

    ===================  ================  ====  =============================================
    symbol               here              unit  meaning
    ===================  ================  ====  =============================================
    :math:`d`            ``value``         1     activation of the value nodes
    :math:`s`            ``context``       1     the state: 1 for nodes with an output above
                                                 1/2, else 0; in the paper the CoS nodes
    :math:`a`            ``available``     1     0 to 1, what is left of an action: 0 for the
                                                 finished one, 1 for others (`Constraints`: less)
    :math:`W`            ``weights``       1     values ``[action, state]``
    :math:`\xi`          ``noise``         1     exploration, one number per action
    :math:`\tau`         ``tau``           s     time constant
    :math:`p`            ``sharpness``     1     how far the others fall behind the best
    :math:`b`            ``baseline``      1     innate preference, small: decides where
                                                 nothing has been learned
    ===================  ================  ====  =============================================

    ``tau``, ``baseline`` and ``sharpness`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``context`` ``(*batch, states)``, ``noise``, ``available`` and output (activation
    after the step) ``(*batch, n)``, ``weights`` ``(*batch, n, states)`` or ``(n, states)``.
    State: ``ValueState(value)``, 0 at rest.

    Raises:
        ValueError: ``dt > tau``, ``baseline`` or ``sharpness`` not positive, ``n < 2``.

    Source: eq. (5) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviations**: printed without the leak :math:`-d_i`, but a pure integrator diverges; the
    text normalises afterwards, here the input is normalised and the nodes relax to it. It
    normalises to a sum of one, which leaves the best of many actions less than an intention
    needs to come on; here the best has 1, however many there are, and the power keeps the
    second from coming on beside it. Printed for positive W only: W may become negative, so the
    sum is rectified, and ``baseline`` is what there is while all W are zero. The preference
    grows slightly with i, since equal nodes never decide without noise. The finished
    behaviour has no value: it may not win again. Noise is not in the paper's equation; here it
    belongs to the action, so that there is a first decision, before there is a state. The output
    :math:`f` is not given: with :math:`f_S` the tails of resting nodes add up to a state.

    >>> nodes = ValueNodes(3)
    >>> weights = torch.tensor([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.5, 0.0, 0.0]])
    >>> for _ in range(32):
    ...     state = torch.tensor([1.0, 0.0, 0.0])  # behaviour 0 is finished
    ...     value = nodes(state, weights, torch.zeros(3), 1 - state)
    >>> [round(each, 3) for each in value.tolist()]
    [0.0, 1.0, 0.235]
    """

    value: Tensor
    ladder: Tensor

    def __init__(
        self,
        n: int,
        tau: Number = 0.1,
        baseline: Number = 1e-3,
        sharpness: Number = 8.0,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.tau, self.baseline, self.sharpness = n, tau, baseline, sharpness
        self.register_buffer("ladder", 1 + torch.arange(n) / n, persistent=False)

    def check(self) -> None:
        check_time_constant("tau", self.tau, self.dt)
        check_positive("sharpness", self.sharpness)
        check_positive("baseline", self.baseline, "at 0 all values may be 0")

    def initial(self, batch: list[int]) -> ValueState:
        return ValueState(self.origin.new_zeros(batch + [self.n]))

    def output(self, state: ValueState) -> Tensor:
        return state.value.clone()

    def euler(
        self,
        context: Tensor,
        weights: Tensor,
        noise: Tensor,
        available: Tensor,
        state: ValueState,
    ) -> ValueState:
        check_ends("weights", weights, [self.n, weights.shape[-1]])
        check_ends("context", context, [weights.shape[-1]])
        check_ends("noise", noise, [self.n])
        check_ends("available", available, [self.n])
        preference = self.ladder * wide(self.baseline, 1)
        sharpness, tau = wide(self.sharpness, 1), wide(self.tau, 1)
        numbers = preference, sharpness, tau, self.dt
        return value_step(context, weights, noise, available, state, *numbers)

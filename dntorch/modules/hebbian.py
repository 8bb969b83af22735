"""Long-term memory of action values."""

import torch
from torch import Tensor

from dntorch.cells.hebbian import HebbianState, hebbian_step
from dntorch.dynamics import Dynamics, check_ends, overwrite


class HebbianQ(Dynamics):
    r"""Action values learned by a Hebbian rule that reward and TD error modulate.

    .. math:: \dot W_{ij} = \eta\, (1 - I_{ij}) (r + v)\, u_{ij}

    =============  =================  ====  ==================================================
    symbol         here               unit  meaning
    =============  =================  ====  ==================================================
    :math:`W`      ``weights``        1     values ``[action, state]``
    :math:`\eta`   ``learning_rate``  1/s   learning rate
    :math:`I`      ``active``         1     state-action cells: the running pair does not learn
    :math:`u`      ``trace``          1     eligibility trace
    :math:`v`      ``error``          1     value cell
    :math:`r`      ``reward``         1     reward signal
    =============  =================  ====  ==================================================

    Shapes: ``active`` and ``trace`` ``(*batch, n, n)``, ``error`` and ``reward`` ``(*batch,)``;
    the output is the weights after the step, ``(*batch, n, n)``.

    The weights are **long-term memory**: a persistent buffer, 0 at first, which ``reset``
    and ``resize`` never touch. ``spread(*batch)`` gives each member of a batch weights of
    its own, ``select(k)`` keeps those of one, ``forget()`` erases them. Their state "at
    rest" is what has been learned. ``learn(False)`` switches learning off; the switch is a
    tensor, so that an exported program keeps it.

    Raises:
        ValueError: ``learning_rate`` not positive; weights whose batch is not that of the
            inputs.

    Source: eq. (12) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics". No deviation; the learning
    rate is not given there.

    >>> values = HebbianQ(2, learning_rate=0.1)
    >>> trace = torch.tensor([[0.0, 0.8], [0.2, 0.0]])
    >>> for _ in range(32):  # one second of reward
    ...     weights = values(torch.zeros(2, 2), trace, torch.tensor(0.0), torch.tensor(1.0))
    >>> weights
    tensor([[0.0000, 0.0800],
            [0.0200, 0.0000]])
    """

    weights: Tensor
    learning: Tensor

    def __init__(self, n: int, learning_rate: float = 0.06, dt: float = 1 / 32) -> None:
        super().__init__(dt)
        if not learning_rate > 0:
            raise ValueError(
                f"learning_rate={learning_rate} must be positive: to switch learning off, "
                "call learn(False)"
            )
        self.n, self.learning_rate = n, learning_rate
        self.register_buffer("weights", torch.zeros(n, n))
        self.register_buffer("learning", torch.ones(()), persistent=False)

    @property
    def state(self) -> HebbianState:
        return HebbianState(self.weights.clone())

    @state.setter
    def state(self, state: HebbianState) -> None:
        if self.weights.shape != state.weights.shape:
            raise ValueError(
                f"weights of shape {list(state.weights.shape)} do not fit the memory of shape "
                f"{list(self.weights.shape)}: call spread(*batch) to give each its own"
            )
        overwrite(self.weights, state.weights)

    def initial(self, batch: list[int]) -> HebbianState:
        """What has been learned, for each member of ``batch``."""
        own = list(self.weights.shape[:-2])
        if batch[len(batch) - len(own) :] != own:
            raise ValueError(
                f"batch={batch} does not fit weights of batch {own}: call select(k) to keep those "
                "of one first"
            )
        return HebbianState(self.weights.expand(batch + [self.n, self.n]).clone())

    @torch.jit.export
    def reset(self) -> None:
        """Nothing to do: all state is long-term memory."""

    @torch.jit.unused
    def resize(self, *batch: int) -> "HebbianQ":
        """Nothing to do: long-term memory does not follow the batch. See `spread`."""
        return self

    @torch.jit.unused
    def spread(self, *batch: int) -> "HebbianQ":
        """Give each member of ``batch`` a copy of the weights, to learn on its own."""
        self.weights = self.initial(list(batch)).weights
        return self

    @torch.jit.unused
    def select(self, index: int) -> "HebbianQ":
        """Keep the weights of one member of the batch, and lose the others'."""
        if self.weights.dim() == 2:
            raise ValueError(f"index={index}: there is one set of weights only, nothing to select")
        self.weights = self.weights.flatten(0, -3)[index].clone()
        return self

    @torch.jit.export
    def forget(self) -> None:
        """Erase all that was learned."""
        self.weights.zero_()

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learning.fill_(float(on))

    def forward(self, active: Tensor, trace: Tensor, error: Tensor, reward: Tensor) -> Tensor:
        output, self.state = self.step(active, trace, error, reward, self.state)
        return output

    def step(
        self, active: Tensor, trace: Tensor, error: Tensor, reward: Tensor, state: HebbianState
    ) -> tuple[Tensor, HebbianState]:
        check_ends("active", active, [self.n, self.n])
        check_ends("trace", trace, [self.n, self.n])
        if reward.dim() > 0 and reward.shape != error.shape:
            raise ValueError(
                f"reward of shape {list(reward.shape)} does not fit the batch "
                f"{list(error.shape)}: give one number for each agent, or call resize(*batch) "
                "with the batch of the inputs first"
            )
        rate = self.learning_rate * self.learning
        state = hebbian_step(active, trace, error, reward, state, rate, self.dt)
        return state.weights, state

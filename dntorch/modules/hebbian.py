"""Long-term memory of action values."""

import torch
from torch import Tensor

from dntorch.cells.hebbian import HebbianState, hebbian_step
from dntorch.checks import check_count, check_ends, check_positive, check_states
from dntorch.dynamics import Dynamics
from dntorch.memory import extended
from dntorch.number import Number


class HebbianQ(Dynamics[HebbianState]):
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

    ``learning_rate`` may be a tensor ``(*batch,)``, one number per agent.

    Shapes: ``active`` and ``trace`` ``(*batch, n, states)``, ``error`` and ``reward``
    ``(*batch,)``; the output is the weights after the step, ``(*batch, n, states)``; ``states`` is
    n unless given.

    The weights are **long-term memory**: a persistent buffer, 0 at first, which ``reset``
    and ``resize`` never touch. ``spread(*batch)`` gives each member of a batch weights of
    its own, ``select(k)`` is a structure with those of one, ``forget()`` erases them. Their
    state "at rest" is what has been learned. ``learn(False)`` switches learning off; the switch
    is a tensor, so that an exported program keeps it.

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

    lasting = ("weights",)
    weights: Tensor
    learning: Tensor

    def __init__(
        self,
        n: int,
        learning_rate: Number = 0.06,
        states: int | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.states = check_states(n, states)
        self.n, self.learning_rate = n, learning_rate
        self.register_buffer("weights", torch.zeros(n, self.states))
        self.register_buffer("learning", torch.ones(()), persistent=False)

    def check(self) -> None:
        check_positive(
            "learning_rate", self.learning_rate, "to switch learning off, call learn(False)"
        )

    def initial(self, batch: list[int]) -> HebbianState:
        """What has been learned, for each member of ``batch``."""
        return HebbianState(extended(self.weights, 2, batch))

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learning.fill_(float(on))

    def output(self, state: HebbianState) -> Tensor:
        return state.weights.clone()

    def euler(
        self, active: Tensor, trace: Tensor, error: Tensor, reward: Tensor, state: HebbianState
    ) -> HebbianState:
        check_ends("active", active, [self.n, self.states])
        check_ends("trace", trace, [self.n, self.states])
        check_ends("error", error, [])
        check_ends("reward", reward, [])
        if reward.dim() > 0 and reward.shape != error.shape:
            raise ValueError(
                f"reward of shape {list(reward.shape)} does not fit the batch "
                f"{list(error.shape)}: give one number for each agent, or call resize(*batch) "
                "with the batch of the inputs first"
            )
        rate = self.learning_rate * self.learning
        return hebbian_step(active, trace, error, reward, state, rate, self.dt)

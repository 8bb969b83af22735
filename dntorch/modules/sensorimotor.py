"""What stands between an agent's behaviours and its world."""

from torch import Tensor

from dntorch.dynamics import Dynamics


class Direct(Dynamics):
    """No senses and no motors: the world speaks to the nodes.

    The observation is the match of each condition of satisfaction, ``(*batch, n)`` between
    0 and 1; the action is the firing rate of each intention. Also the pattern for other
    sensorimotor systems: `DNSarsa` asks one for ``match``, ``advance`` and ``act``.
    State: an empty dict; others name a tensor for each field they hold.
    """

    def __init__(self, dt: float = 1 / 32) -> None:
        super().__init__(dt)

    @property
    def state(self) -> dict[str, Tensor]:
        state: dict[str, Tensor] = {}
        return state

    @state.setter
    def state(self, state: dict[str, Tensor]) -> None:
        pass

    def initial(self, batch: list[int]) -> dict[str, Tensor]:
        state: dict[str, Tensor] = {}
        return state

    def forward(self, observation: Tensor, intention: Tensor) -> Tensor:
        output, self.state = self.step(observation, intention, self.state)
        return output

    def step(
        self, observation: Tensor, intention: Tensor, state: dict[str, Tensor]
    ) -> tuple[Tensor, dict[str, Tensor]]:
        state = self.advance(observation, intention, state)
        return self.act(intention, state), state

    def match(self, observation: Tensor, state: dict[str, Tensor]) -> Tensor:
        """How well the percept fits each condition of satisfaction, ``(*batch, n)``."""
        return observation

    def advance(
        self, observation: Tensor, intention: Tensor, state: dict[str, Tensor]
    ) -> dict[str, Tensor]:
        """One step of the fields."""
        return state

    def act(self, intention: Tensor, state: dict[str, Tensor]) -> Tensor:
        """The motor command."""
        return intention

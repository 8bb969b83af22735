"""The face of a pure world: a state, and a step that is a function of action and state."""

from typing import Any, NamedTuple, Protocol

from torch import Tensor

from dntorch.envs.task import SequenceTask


class Outcome(NamedTuple):
    """What a world answers to an action, for every agent of the batch."""

    observation: dict[str, Tensor]
    """of each name in the world's ``senses``"""
    reward: Tensor
    """``(*batch,)``"""
    found: Tensor
    """Position of the colour found in this step or ``NOTHING``, ``(*batch,)``, int64."""
    completed: Tensor
    """The sequence was completed in this step, ``(*batch,)``, bool."""


class PureWorld(Protocol):
    """What an engine needs of a world.

    A state is a ``NamedTuple`` of tensors (and of such tuples), all with the batch first.
    `step` changes nothing, branches on no data and draws no random numbers: chance, if any,
    enters through ``seed`` and ``agents``.
    """

    senses: tuple[str, ...]
    """Names in an observation."""
    task: SequenceTask
    n: int
    """Number of colours."""
    actions: int
    """Length of an action."""
    action_range: tuple[float, float]
    """Least and largest value of its parts."""

    def initial(
        self, batch: list[int] | None = None, seed: int | Tensor = 0, agents: int | Tensor = 0
    ) -> Any:
        """State at the start for agents ``(*batch,)``, of one seed and number or of their own."""

    def observe(self, state: Any) -> dict[str, Tensor]:
        """The observation in a state."""

    def step(self, action: Tensor, state: Any) -> tuple[Outcome, Any]:
        """One control step later."""

"""What every world is: a pure step from an action to what it brought about."""

from typing import Any, Generic, NamedTuple, TypeVar

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.envs.task import SequenceTask

S = TypeVar("S")


class Outcome(NamedTuple):
    """What a world answers to an action."""

    observation: dict[str, Tensor]
    """by name, of each sense of the world"""
    reward: Tensor
    """size of the reward signal, ``(*batch,)``"""
    found: Tensor
    """position of the colour found in this step, or ``NOTHING``, ``(*batch,)``, int64"""
    completed: Tensor
    """the rewarded sequence was completed in this step, ``(*batch,)``, bool"""


class World(Generic[S]):
    """Base of the worlds. A subclass sets ``senses`` and ``task`` and writes

    * ``initial(batch, seed, agents) -> state``: the first moment, one world per agent;
    * ``observe(state) -> observation``: what is to be seen in it, a dict of tensors by name;
    * ``step(action, state) -> (outcome, state)``: one control step of ``task.dt`` seconds.

    A *pure* world has a NamedTuple of tensors with the batch first as its state, and a step
    without side effects or branches on data: it runs in any batch, compiled, on any device.
    One with a body elsewhere (PyBullet, a robot) has ``pure = False``, no batch, and a state
    that names a moment of that body; `snapshot` and `restore` hold what a resume needs.
    """

    pure = True
    senses: tuple[str, ...]
    task: SequenceTask

    @property
    def actions(self) -> tuple[int, float, float]:
        """How many numbers an action has, the smallest and the largest."""
        raise NotImplementedError

    @property
    def n(self) -> int:
        """Number of colours, and of behaviours that find them."""
        return len(self.task.colors)

    def initial(
        self, batch: tuple[int, ...] = (), seed: int | Tensor = 0, agents: int | Tensor = 0
    ) -> S:
        raise NotImplementedError

    def observe(self, state: S) -> dict[str, Tensor]:
        raise NotImplementedError

    def step(self, action: Tensor, state: S) -> tuple[Outcome, S]:
        raise NotImplementedError

    def again(self, first: S, last: S) -> S:
        """A new episode that begins in ``first``, after one that ended in ``last``."""
        return first

    def provide(self, state: S) -> S:
        """The same state with chance drawn ahead, for those who compile `step`.

        A world without chance in its steps gives the state back.
        """
        return state

    def due(self, state: S) -> bool:
        """Whether `provide` is due within the next 16 steps."""
        return False

    def snapshot(self, state: S) -> Any:
        """All that a resume needs, as tensors."""
        return [leaf.clone() for leaf in pytree.tree_leaves(state)]

    def restore(self, snapshot: Any, state: S) -> S:
        """The state of a `snapshot`, in the form of ``state``."""
        return pytree.tree_unflatten(snapshot, pytree.tree_structure(state))

    def close(self) -> None:
        """Give back what the world holds outside of its state; a second call does nothing."""


def individuals(
    batch: tuple[int, ...], seed: int | Tensor, agents: int | Tensor
) -> tuple[Tensor, Tensor]:
    """Seed and number of each agent, int64, ``(*batch,)``: who draws what depends on both.

    Raises:
        ValueError: seeds or numbers of another batch.
    """
    numbers = [torch.as_tensor(value, dtype=torch.int64) for value in (seed, agents)]
    try:
        shape = torch.broadcast_shapes(tuple(batch), *(number.shape for number in numbers))
        wrong = bool(batch) and shape != tuple(batch)
    except RuntimeError:
        wrong = True
    if wrong:
        shapes = [list(number.shape) for number in numbers]
        raise ValueError(
            f"seed and agents of shapes {shapes} do not fit batch={list(batch)}: give one number, "
            "or one for each agent"
        )
    return numbers[0].expand(shape).clone(), numbers[1].expand(shape).clone()

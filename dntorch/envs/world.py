"""What every world is: a pure step from an action to what it brought about."""

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.envs.task import SequenceTask
from dntorch.noise import MASK
from dntorch.quantities import Interval, shown

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
        """The state of a `snapshot`, in the form of ``state``.

        Raises:
            ValueError: it is of another world or batch.
        """
        leaves, structure = pytree.tree_flatten(state)
        if not isinstance(snapshot, (list, tuple)) or _forms(snapshot) != _forms(leaves):
            raise ValueError(
                f"the snapshot is not of this {type(self).__name__} or not of its batch: restore "
                "it with a state of the world and batch it was taken of"
            )
        moved = [new.to(own.device) for new, own in zip(snapshot, leaves)]
        return pytree.tree_unflatten(moved, structure)

    def close(self) -> None:
        """Give back what the world holds outside of its state; a second call does nothing."""


def _forms(leaves: Any) -> list:
    return [(x.shape, x.dtype) if isinstance(x, Tensor) else type(x) for x in leaves]


def check_action(name: str, action: Tensor, batch: Sequence[int], size: int, remedy: str) -> None:
    """Raise a ``ValueError`` unless there is one action for each agent; others would broadcast."""
    if not isinstance(action, Tensor):
        raise ValueError(f"{name} is a {type(action).__name__}: give torch.as_tensor({name})")
    if action.shape != (*batch, size):
        raise ValueError(
            f"{name} of shape {list(action.shape)} does not fit {[*batch, size]}: begin with "
            f"initial(batch) and {remedy}"
        )


NUMBERS = Interval(0, MASK, whole=True)
"""Seeds, and numbers of agents."""


def individuals(
    batch: tuple[int, ...], seed: int | Tensor, agents: int | Tensor
) -> tuple[Tensor, Tensor]:
    """Seed and number of each agent, int64, ``(*batch,)``: who draws what depends on both.

    Raises:
        ValueError: a batch that is none, seeds or numbers that are no whole numbers of 32 bits, or
            of another batch.
    """
    if not isinstance(batch, Sequence) or any(size not in NUMBERS for size in batch):
        raise ValueError(f"batch={batch!r}: give a tuple of whole numbers, such as (8,)")
    numbers = [_whole("seed", seed), _whole("agents", agents)]
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


def _whole(name: str, value: int | Tensor) -> Tensor:
    if isinstance(value, Tensor):
        whole = not (value.is_floating_point() or value.is_complex() or value.dtype == torch.bool)
        right = whole and bool(((value >= 0) & (value <= MASK)).all())
    else:
        right = value in NUMBERS
    if not right:
        raise ValueError(f"{name}={shown(value)}: give {NUMBERS}, or an int64 tensor of them")
    return torch.as_tensor(value, dtype=torch.int64)

"""Structures as others write them: with annotations as strings, generic, without annotations."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

from torch import Tensor

from dntorch import Dynamics, NodeWTA
from dntorch.cells.node import NodeState

T = TypeVar("T")
S = TypeVar("S")


class LevelState(NamedTuple):
    level: Tensor


class Level(Dynamics[LevelState]):
    def __init__(self, n: int, tau: float = 0.5) -> None:
        super().__init__(1 / 32)
        self.n, self.tau = n, tau

    def initial(self, batch: list[int]) -> LevelState:
        return LevelState(self.origin.new_zeros(batch + [self.n]))

    def euler(self, input: Tensor, state: LevelState) -> LevelState:
        return LevelState(state.level.lerp(input, self.dt / self.tau))

    def output(self, state: LevelState) -> Tensor:
        return state.level.clone()


class BothState(NamedTuple):
    level: LevelState
    nodes: NodeState


class Both(Dynamics[BothState]):
    def __init__(self, n: int) -> None:
        super().__init__(1 / 32)
        self.level, self.nodes = Level(n), NodeWTA(n)

    def euler(self, input: Tensor, state: BothState) -> BothState:
        driven = self.nodes.euler(8 * state.level.level, state.nodes)
        return BothState(self.level.euler(input, state.level), driven)

    def output(self, state: BothState) -> Tensor:
        return self.nodes.output(state.nodes)


class Labelled(Level, Generic[T]):
    """A mixin of another kind is no state."""


class Named(Labelled[int]):
    pass


class Base(Dynamics[S], Generic[S, T]):
    """A base whose state is one of its parameters."""

    def __init__(self, n: int) -> None:
        super().__init__(1 / 32)
        self.n = n


class Derived(Base[LevelState, int]):
    def initial(self, batch):
        return LevelState(self.origin.new_zeros(batch + [self.n]))

    def euler(self, input, state):
        return LevelState(state.level.lerp(input, 0.5))

    def output(self, state):
        return state.level.clone()

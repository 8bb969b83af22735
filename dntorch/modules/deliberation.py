"""What a decision weighs besides the learned values: parts that an agent may have."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import is_on
from dntorch.dynamics import Dynamics, check_parts
from dntorch.modules.constraints import Constraints
from dntorch.modules.curiosity import Curiosity
from dntorch.modules.habituation import Habituation
from dntorch.modules.recall import Recall


class DeliberationState(NamedTuple):
    """Tensors of each part by name; none where it is missing."""

    recall: dict[str, Tensor]
    habituation: dict[str, Tensor]
    constraints: dict[str, Tensor]
    curiosity: dict[str, Tensor]


class Deliberation(Dynamics[DeliberationState]):
    r"""Turns what was completed, failed and seen into what `ValueNodes` and `Learner` read.

    ===============  =================  ========================================================
    what they read   here               is, without the part in brackets
    ===============  =================  ========================================================
    ``context``      the state          the last completion (`Recall`)
    ``noise``        what is tried      the noise of exploration, all of it equally fresh
                                        (`Habituation`), without intrinsic value (`Curiosity`)
    ``available``    what may be done   all but the finished behaviour (`Constraints`)
    ===============  =================  ========================================================

    Without parts it is the paper's agent. `weigh` says what they read, `euler` moves the parts on;
    both read the activation of time t.

    Shapes: ``intention``, ``satisfaction`` and ``failing`` (firing rates) ``(*batch, n)``,
    ``pulse`` of the learner's pairs ``(*batch, n, states)``, ``noise`` ``(*batch, n)``,
    ``observation`` with ``lamp`` ``(*batch, 1)`` if there is curiosity; `weigh` and `step` give
    ``context`` ``(*batch, states)``, noise and what is available ``(*batch, n)``.
    State: ``DeliberationState``, the parts' states.

    Raises:
        ValueError: parts of another size or ``dt``; constraints of other states than recall's.

    Not in the paper.

    >>> import torch
    >>> parts, none = Deliberation(2, habituation=Habituation(2, order=1)), torch.zeros(2)
    >>> done, noise, seen = torch.eye(2)[0], torch.ones(2), {"match": none}
    >>> for _ in range(64):  # behaviour 1 runs after behaviour 0: it is new no more
    ...     weighed = parts(torch.eye(2)[1], done, none, torch.zeros(2, 2), noise, seen)
    >>> context, tried, available = weighed
    >>> context.tolist(), tried.round(decimals=2).tolist(), available.tolist()
    ([1.0, 0.0], [1.0, 0.0], [False, True])
    """

    __jit_unused_properties__ = ("senses",)

    def __init__(
        self,
        n: int,
        recall: Recall | None = None,
        habituation: Habituation | None = None,
        constraints: Constraints | None = None,
        curiosity: Curiosity | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        self.n, self.recall, self.habituation = n, recall, habituation
        self.states = n if recall is None else recall.states
        self.constraints, self.curiosity = constraints, curiosity

    def check(self) -> None:
        check_parts(self, self.n)
        own = self.n if self.recall is None else self.recall.states
        if own != self.states:
            raise ValueError(
                f"recall of {own} states does not fit the {self.states} of this agent: build "
                "another agent with it"
            )
        if self.constraints is not None:
            check_states_fit("constraints", self.constraints.states, self.states)

    @property
    def senses(self) -> tuple[str, ...]:
        """Names in an observation that the parts read."""
        return () if self.curiosity is None else ("lamp",)

    def sense(self, observation: dict[str, Tensor]) -> dict[str, Tensor]:
        """What the parts read of an observation."""
        seen: dict[str, Tensor] = {}
        if self.curiosity is not None:
            if "lamp" not in observation:
                raise ValueError(
                    f"the observation lacks 'lamp', it has {list(observation.keys())}: ask the "
                    "world for it, or leave curiosity out"
                )
            seen["lamp"] = observation["lamp"].to(self.curiosity.weights.dtype)
        return seen

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off in the parts that learn."""
        if self.constraints is not None:
            self.constraints.learn(on)
        if self.curiosity is not None:
            self.curiosity.learn(on)

    def context(self, satisfaction: Tensor, state: DeliberationState) -> Tensor:
        """Rates of the states, ``(*batch, states)``."""
        if self.recall is None:
            return satisfaction
        recalled = self.recall.output(self.recall.nested(state.recall))
        return self.recall.context(satisfaction, recalled)

    def weigh(
        self,
        satisfaction: Tensor,
        noise: Tensor,
        observation: dict[str, Tensor],
        state: DeliberationState,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """``(context, noise, available)``."""
        context, available = self.context(satisfaction, state), ~is_on(satisfaction)
        if self.habituation is not None:
            spent = self.habituation.nested(state.habituation)
            noise = noise * self.habituation.fresh(satisfaction, spent)
        if self.curiosity is not None:
            learned = self.curiosity.nested(state.curiosity)
            noise = noise + self.curiosity.value(observation["lamp"], learned)
        if self.constraints is not None:
            known = self.constraints.nested(state.constraints)
            available = available * self.constraints.allowed(context, known)
        return context, noise, available

    def euler(
        self,
        intention: Tensor,
        satisfaction: Tensor,
        failing: Tensor,
        context: Tensor,
        pulse: Tensor,
        observation: dict[str, Tensor],
        state: DeliberationState,
    ) -> DeliberationState:
        recall, habituation = state.recall, state.habituation
        constraints, curiosity = state.constraints, state.curiosity
        if self.recall is not None:
            ahead = self.recall.euler(satisfaction, self.recall.nested(recall))
            recall = self.recall.flat(ahead)
        if self.habituation is not None:
            spent = self.habituation.nested(habituation)
            spent = self.habituation.euler(intention, satisfaction, spent)
            habituation = self.habituation.flat(spent)
        if self.constraints is not None:
            known = self.constraints.nested(constraints)
            known = self.constraints.euler(failing, context, satisfaction, pulse, known)
            constraints = self.constraints.flat(known)
        if self.curiosity is not None:
            learned = self.curiosity.nested(curiosity)
            learned = self.curiosity.euler(intention, observation["lamp"], learned)
            curiosity = self.curiosity.flat(learned)
        return DeliberationState(recall, habituation, constraints, curiosity)

    def step(
        self,
        intention: Tensor,
        satisfaction: Tensor,
        failing: Tensor,
        pulse: Tensor,
        noise: Tensor,
        observation: dict[str, Tensor],
        state: DeliberationState,
    ) -> tuple[tuple[Tensor, Tensor, Tensor], DeliberationState]:
        context, _, _ = self.weigh(satisfaction, noise, observation, state)
        rates = intention, satisfaction, failing
        state = self.euler(*rates, context, pulse, observation, state)
        return self.weigh(satisfaction, noise, observation, state), state


def check_states_fit(name: str, own: int, states: int) -> None:
    """Raise unless a part pairs its actions with as many states as the agent has."""
    if own != states:
        raise ValueError(
            f"{name}.states={own} does not fit: build the part with states={states}, those of "
            "recall or, without one, n"
        )

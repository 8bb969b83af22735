"""What stands between an agent's behaviours and its world."""

import math
from typing import Any, TypeVar

import torch
from torch import Tensor

from dntorch import declare
from dntorch.checks import check_positive
from dntorch.dynamics import Dynamics

S = TypeVar("S")

STEP = """
def step(
    self, observation: dict[str, Tensor], intention: Tensor, state: State
) -> tuple[Tensor, State]:
    state = self.advance(self.sense(observation), intention, state)
    return self.limit(self.act(intention, state)), state
"""
# Never called for n = 0, but TorchScript compiles the call.
NO_MATCH = """
def match(self, observation: dict[str, Tensor], state: State) -> Tensor:
    return self.origin
"""


class Sensorimotor(Dynamics[S]):
    """Base of what gives behaviours senses and motors. A subclass writes

    * ``senses``: the keys of the observation that it reads;
    * ``n``: how many behaviours it has; 0 for one that is always on;
    * ``match(observation, state)``: how well the percept fits each condition of satisfaction,
      ``(*batch, n)`` between 0 and 1 (not needed for ``n = 0``; one that reads the state alone
      calls the first ``_observation``);
    * ``advance(observation, intention, state) -> state``: one step of its fields;
    * ``act(intention, state)``: the motor command, unlimited, ``(*batch, motors)``;

    and declares its state as every structure does (`Dynamics`). `DNSarsa` calls the three, with
    the state of time t; alone the part is stepped with ``(observation, intention)``.

    An observation is a dict of tensors by name, with the keys of the worlds: ``image``,
    ``proximity``, ``wheels``, ``match``. What nobody reads is dropped before the step.

    Attributes:
        max_speed: largest absolute value of the motor command, wheel speeds in rad/s;
            infinite for one that has no limit. Whoever holds the whole body limits, once.
    """

    _matches = True
    senses = ("",)  # without annotation: TorchScript knows no tuple of any length

    def __init_subclass__(cls, **kwargs: Any) -> None:
        state = declare.state_type(cls, Dynamics)
        if state is not None:
            names = {"State": state, "Tensor": Tensor}
            declare.add_methods(cls, STEP, names)
            if not hasattr(cls, "match"):
                declare.add_methods(cls, NO_MATCH, names)
                cls._matches = False
        super().__init_subclass__(**kwargs)

    def __init__(self, dt: float = 1 / 32, max_speed: float = math.inf) -> None:
        super().__init__(dt)
        self.max_speed = max_speed
        for name in ("senses", "n"):  # TorchScript sees what the object has, not its class
            if hasattr(type(self), name):
                setattr(self, name, getattr(type(self), name))

    def check(self) -> None:
        check_positive("max_speed", self.max_speed)
        for name in ("advance", "act"):
            if not hasattr(self, name):
                raise TypeError(f"{type(self).__name__} lacks {name}: see dntorch.Sensorimotor")
        if isinstance(self.senses, str):
            raise ValueError(f"senses={self.senses!r} is a string: write ({self.senses!r},)")
        if self.senses == ("",):
            raise ValueError(
                f"{type(self).__name__} does not say what it reads: give it senses = ('image',)"
            )
        if getattr(self, "n", 0) > 0 and not self._matches:
            raise ValueError(f"n={self.n}: {type(self).__name__} needs match(observation, state)")

    def sense(self, observation: dict[str, Tensor]) -> dict[str, Tensor]:
        """What this part reads of an observation."""
        if not torch.jit.is_scripting():
            _check_names(observation)
        seen: dict[str, Tensor] = {}
        for name in self.senses:
            if name not in observation:
                raise ValueError(
                    f"the observation lacks '{name}', it has {list(observation.keys())}: give what "
                    f"the world shows under the names {self.senses}"
                )
            seen[name] = observation[name]
        return seen

    def limit(self, action: Tensor) -> Tensor:
        if self.max_speed == math.inf:
            return action
        return action.clamp(-self.max_speed, self.max_speed)


@torch.jit.unused
def _check_names(observation: dict[str, Tensor]) -> None:
    if not isinstance(observation, dict):
        raise TypeError(
            f"observation is a {type(observation).__name__}: give a dict of tensors by name, such "
            "as {'image': image}"
        )
    for name, value in observation.items():
        if not isinstance(value, Tensor):
            raise TypeError(
                f"observation[{name!r}] is a {type(value).__name__}: give a tensor, such as "
                "torch.as_tensor(value)"
            )


class Direct(Sensorimotor[dict[str, Tensor]]):
    """No senses and no motors: the world speaks to the nodes, of any number.

    The observation ``match`` is the match of each condition of satisfaction, ``(*batch, n)``
    between 0 and 1; the action is the firing rate of each intention. No state.
    """

    senses = ("match",)

    def __init__(self, dt: float = 1 / 32) -> None:
        super().__init__(dt)

    def match(self, observation: dict[str, Tensor], state: dict[str, Tensor]) -> Tensor:
        return observation["match"]

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: dict[str, Tensor]
    ) -> dict[str, Tensor]:
        return state

    def act(self, intention: Tensor, state: dict[str, Tensor]) -> Tensor:
        return intention.clone()

"""Several kinds of behaviour in one body."""

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

from dntorch.checks import check_ends
from dntorch.modules.sensorimotor import Sensorimotor
from dntorch.plumbing import within


class Parts(nn.ModuleList):
    """The parts of one body, which was built for just these: none is added, replaced or removed."""

    def __init__(self, parts: Iterable[Sensorimotor]) -> None:
        super().__init__()
        for k, part in enumerate(parts):
            nn.Module.add_module(self, str(k), part)

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise ValueError(
            "parts are fixed when a Repertoire is built: build another Repertoire(*parts)"
        )

    __setitem__ = __delitem__ = __iadd__ = add_module = append = extend = insert = pop = _refuse


class Repertoire(Sensorimotor[dict[str, Tensor]]):
    r"""One repertoire of behaviours out of several sensorimotor parts.

    .. math:: \text{action} = \operatorname{clamp}\Big(\sum_p \text{action}_p,\ \pm v_{max}\Big)

    Behaviours are numbered in the order of the parts: the first ``parts[0].n`` are those of
    the first. A part sees its own behaviours' intentions and its own senses; one without
    behaviours (``n = 0``) is always on, such as one that keeps away from walls.

    Shapes: ``observation`` by name, the union of the parts' ``senses``; ``intention``
    ``(*batch, n)`` with n the sum over the parts; action ``(*batch, motors)``, the sum of what
    the parts want, limited once.
    State: the parts' states by name, behind the number of the part: ``parts.0.perception.u``.

    Args:
        parts: any number of `Sensorimotor`, with the same motors and ``dt``.
        max_speed: largest absolute wheel speed, rad/s; at most the smallest of the parts'.

    Raises:
        ValueError: no part, or one with another ``dt``.
        TypeError: a part that is no `Sensorimotor`.

    Not in the paper.

    >>> from dntorch import FindColor
    >>> body = Repertoire(FindColor("RG"), FindColor("BY"))
    >>> image = torch.zeros(39, 52, 3, dtype=torch.uint8)
    >>> image[10:30, 5:15, 2] = 255  # a blue block on the left
    >>> for _ in range(32):
    ...     action = body({"image": image}, torch.tensor([0.0, 0.0, 1.0, 0.0]))  # find blue
    >>> bool(action[0] < -0.39 and action[1] > 0.39)  # turns left, faster than it scans
    True
    """

    def __init__(self, *parts: Sensorimotor, max_speed: float = math.inf) -> None:
        for k, part in enumerate(parts):
            if not isinstance(part, Sensorimotor):
                kind = (
                    part.__name__ + ", a class" if isinstance(part, type) else type(part).__name__
                )
                raise TypeError(
                    f"parts[{k}] is a {kind}: give structures, as Repertoire(FindColor(), Other())"
                )
            if not hasattr(part, "n"):
                raise ValueError(f"parts[{k}], a {type(part).__name__}, does not say its n")
        if not parts:
            raise ValueError("parts=(): give at least one sensorimotor part")
        fastest = min(part.max_speed for part in parts)
        super().__init__(parts[0].dt, min(fastest, max_speed))
        self.parts = Parts(parts)
        self.n = sum(part.n for part in parts)
        self.senses = tuple(dict.fromkeys(name for part in parts for name in part.senses))

    @property
    def state(self) -> dict[str, Tensor]:
        state: dict[str, Tensor] = {}
        for k, part in enumerate(self.parts):
            for name, x in part.flat(part.state).items():
                state[f"parts.{k}.{name}"] = x
        return state

    @state.setter
    def state(self, state: dict[str, Tensor]) -> None:
        if not torch.jit.is_scripting():
            self._require_state(state)
        self.write(state)

    def write(self, state: dict[str, Tensor]) -> None:
        for k, part in enumerate(self.parts):
            part.write(part.nested(within(state, f"parts.{k}.")))

    def initial(self, batch: list[int]) -> dict[str, Tensor]:
        rest: dict[str, Tensor] = {}
        for k, part in enumerate(self.parts):
            for name, x in part.flat(part.initial(batch)).items():
                rest[f"parts.{k}.{name}"] = x
        return rest

    @torch.jit.export
    def reset(self) -> None:
        for part in self.parts:
            part.reset()

    @torch.jit.export
    def forget(self) -> None:
        for part in self.parts:
            part.forget()

    def match(self, observation: dict[str, Tensor], state: dict[str, Tensor]) -> Tensor:
        matches: list[Tensor] = []
        for k, part in enumerate(self.parts):
            if part.n > 0:
                own = within(state, f"parts.{k}.")
                matches.append(part.match(part.sense(observation), part.nested(own)))
        return torch.cat(matches, -1)

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: dict[str, Tensor]
    ) -> dict[str, Tensor]:
        check_ends("intention", intention, [self.n])
        ahead: dict[str, Tensor] = {}
        first = 0
        for k, part in enumerate(self.parts):
            seen, wanted = part.sense(observation), intention.narrow(-1, first, part.n)
            own = within(state, f"parts.{k}.")
            for name, x in part.flat(part.advance(seen, wanted, part.nested(own))).items():
                ahead[f"parts.{k}.{name}"] = x
            first += part.n
        return ahead

    def act(self, intention: Tensor, state: dict[str, Tensor]) -> Tensor:
        actions: list[Tensor] = []
        first = 0
        for k, part in enumerate(self.parts):
            wanted, own = intention.narrow(-1, first, part.n), within(state, f"parts.{k}.")
            actions.append(part.act(wanted, part.nested(own)))
            first += part.n
        for k, action in enumerate(actions):
            if action.shape[-1] != actions[0].shape[-1]:
                raise ValueError(
                    f"parts.{k} has {action.shape[-1]} motors, parts.0 {actions[0].shape[-1]}: "
                    "give parts for one body"
                )
        return torch.stack(actions).sum(0)

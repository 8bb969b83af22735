"""Intrinsic value of progress that can be perceived."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.coincidence import coincidence
from dntorch.cells.curiosity import curiosity_step, tuned
from dntorch.cells.functions import rectified
from dntorch.cells.transient import TransientState
from dntorch.checks import check_count, check_ends, check_positive
from dntorch.dynamics import Dynamics
from dntorch.memory import extended
from dntorch.modules.transient import TPCell
from dntorch.number import Number, span, wide


class CuriosityState(NamedTuple):
    lamp: TransientState
    pulses: TransientState
    weights: Tensor
    """Intrinsic values ``[action, level]``, ``(*batch, n, levels)``: long-term memory."""


class Curiosity(Dynamics[CuriosityState]):
    r"""Learns which action makes a lamp brighter that shows how far one has come.

    .. math::
        \dot W_{ik} = \eta\, [-TP_{ik}]_+ (c\, l - W_{ik}), \qquad q_i = \sum_k W_{ik} b_k

    ================  =================  ====  ================================================
    symbol            here               unit  meaning
    ================  =================  ====  ================================================
    :math:`W`         ``weights``        1     intrinsic values ``[action, level]``
    :math:`b`         `level`            1     nodes tuned to ``levels`` brightnesses
    :math:`TP`        ``pulses``         1     transient pulse cells of the pairs of an intention
                                               and a level, negative when a pair goes off
    :math:`l`         ``lamp``           1     transient pulse cell of the brightness: positive
                                               when it rises, negative when it falls
    :math:`c`         ``gain``           1     size of the intrinsic reward
    :math:`\eta`      ``learning_rate``  1/s   learning rate
    :math:`q`         `value`            1     intrinsic value of each action now
    ================  =================  ====  ================================================

    The detectors are those of the learner (`TPCell`), the reward is the change of the lamp. Its
    value is immediate, without discounted future: one would give a value to every detour that
    leads back to the lamp, also to those that explore nothing. It is added to the learned values.
    At the highest level there are no pairs: what follows a completed sequence is not to blame that
    the lamp goes out. While an intention outlasts the change that it made, its pair with the new
    level learns, too: of the behaviour that was just finished, and is not available there.

    ``learning_rate`` and ``gain`` may be tensors ``(*batch,)``, one number per agent.

    Shapes: ``intention`` ``(*batch, n)``, ``brightness`` ``(*batch, 1)`` between 0 and 1, output
    (intrinsic values of the actions after the step) ``(*batch, n)``.
    State: ``CuriosityState(lamp, pulses, weights)``, pulses 0 at rest; the weights are **long-term
    memory** as in `HebbianQ`.

    Args:
        n: number of behaviours.
        levels: how many brightnesses are told apart, dark included.
        lamp, pulses: detectors with another time constant.

    Raises:
        ValueError: ``learning_rate`` or ``gain`` not positive, fewer than two levels.

    Not in the paper.

    >>> curiosity, dark, bright = Curiosity(2, levels=2), torch.zeros(1), torch.ones(1)
    >>> for k in range(96):  # behaviour 1 runs in the dark, and the lamp goes on
    ...     value = curiosity(torch.eye(2)[1] * (k < 64), dark if k < 64 else bright)
    >>> bool(curiosity.weights[1, 0] > 0.1), int(curiosity.weights.count_nonzero())
    (True, 1)
    """

    lasting = ("weights",)
    weights: Tensor
    learning: Tensor
    below: Tensor

    def __init__(
        self,
        n: int,
        levels: int,
        learning_rate: Number = 4.0,
        gain: Number = 4.0,
        threshold: float = 0.05,
        lamp: TPCell | None = None,
        pulses: TPCell | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        check_count("levels", levels, 2)
        self.n, self.levels = n, levels
        self.learning_rate, self.gain, self.threshold = learning_rate, gain, threshold
        self.lamp = lamp or TPCell((1,), dt=dt)
        self.pulses = pulses or TPCell((n, levels), dt=dt)
        self.register_buffer("weights", torch.zeros(n, levels))
        self.register_buffer("learning", torch.ones(()), persistent=False)
        below = torch.ones(n, levels)
        below[:, -1] = 0
        self.register_buffer("below", below, persistent=False)

    def check(self) -> None:
        check_positive("learning_rate", self.learning_rate, "leave the part out to learn nothing")
        check_positive("gain", self.gain)
        check_positive("threshold", self.threshold, "at 0 a pulse never ends")
        for name, part, shape in (
            ("lamp", self.lamp, (1,)), ("pulses", self.pulses, (self.n, self.levels))
        ):  # fmt: skip
            if tuple(part.shape) != shape:
                raise ValueError(
                    f"{name}.shape={tuple(part.shape)} does not fit: build TPCell({shape})"
                )
        if self.dt * span(self.learning_rate)[1] > 1:
            raise ValueError(
                f"learning_rate={span(self.learning_rate)[1]} is too large for dt={self.dt}: give "
                f"at most {1 / self.dt:.4g}"
            )

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learning.fill_(float(on))

    def initial(self, batch: list[int]) -> CuriosityState:
        """At rest, with what has been learned, for each member of ``batch``."""
        return CuriosityState(
            self.lamp.initial(batch),
            self.pulses.initial(batch),
            extended(self.weights, 2, batch),
        )

    def level(self, brightness: Tensor) -> Tensor:
        """Rates of the nodes tuned to brightnesses, ``(*batch, levels)``."""
        check_ends("lamp", brightness, [1])
        return tuned(brightness, self.levels)

    def value(self, brightness: Tensor, state: CuriosityState) -> Tensor:
        """Intrinsic value of each action at this brightness, ``(*batch, n)``."""
        return (state.weights * self.level(brightness).unsqueeze(-2)).sum(-1)

    def step(
        self, intention: Tensor, brightness: Tensor, state: CuriosityState
    ) -> tuple[Tensor, CuriosityState]:
        state = self.euler(intention, brightness, state)
        return self.value(brightness, state), state

    def euler(self, intention: Tensor, brightness: Tensor, state: CuriosityState) -> CuriosityState:
        check_ends("intention", intention, [self.n])
        pairs = coincidence(intention, self.level(brightness), self.below, 0.5)
        offset = rectified(-state.pulses.pulse, self.threshold)
        change = state.lamp.pulse.unsqueeze(-1)
        rate = wide(self.learning_rate, 2) * self.learning
        return CuriosityState(
            self.lamp.euler(brightness, state.lamp),
            self.pulses.euler(pairs, state.pulses),
            curiosity_step(offset, change, state.weights, rate, wide(self.gain, 2), self.dt),
        )

"""The task of the paper: reward follows when colours were found in one particular order.

Shared by all worlds. The task only sees what the *world* judged as found, never
what an agent says of itself.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.colors import PAPER, REWARD, REWARD_DURATION, SEQUENCE, indices
from dntorch.quantities import Interval, check_quantities, shown

NOTHING = -1
"""What ``found`` holds for an agent that found nothing in this step."""
SIZE, DURATION = Interval(-1e6, 1e6), Interval(0, 1e6, unit="s")
STEPS = Interval(1, 10**12, whole=True)


class TaskState(NamedTuple):
    recent: Tensor
    """Last found colours, oldest first, ``(*batch, length)``, int64, ``NOTHING`` at first."""
    remaining: Tensor
    """Control steps of reward still to come, ``(*batch,)``, int64."""
    age: Tensor
    """Control steps taken since `SequenceTask.initial`, ``(*batch,)``, int64."""


class SequenceTask:
    """Reward of size ``reward`` for ``duration`` seconds each time ``sequence`` is completed.

    The last colour of one sequence counts as the first of the next: who repeats
    G-B-Y-R-G-B-Y-R-G … is rewarded every four behaviours.

    Args:
        sequence: letters of the rewarded order; none may follow itself.
        colors: letters of the repertoire; ``found`` holds positions in it.
        reward: size of the reward signal, per step (not per second).
        duration: its length in seconds ("a few time steps" in the paper).
        dt: seconds a control step.
        others: further sequences of the same length, rewarded alike.
        then: ``(sequence, step)``: another sequence of the same length, which alone is rewarded
            after ``step`` control steps of an episode. What was found before them still counts.

    Attributes:
        targets: all sequences as positions in ``colors``, int64 ``(sequences, length)``: the
            first, ``others``, and that of ``then``.

    Raises:
        ValueError: unknown or repeated letters, sequences of different lengths, ``duration``
            shorter than a step, a ``step`` that is no whole number from 1.
    """

    def __init__(
        self,
        sequence: str = SEQUENCE,
        colors: str = PAPER,
        reward: float = REWARD,
        duration: float = REWARD_DURATION,
        dt: float = 1 / 32,
        others: tuple[str, ...] = (),
        then: tuple[str, int] | None = None,
    ) -> None:
        check_quantities(dt=dt)
        self.sequence, self.colors, self.reward, self.dt = sequence, colors, reward, dt
        self.duration, self.others, self.then = duration, others, then
        if not isinstance(others, (tuple, list)):
            raise ValueError(f"others={shown(others)}: give a tuple of sequences")
        rewarded = [indices(each, colors) for each in (sequence, *others)]
        if any(len(other) != len(sequence) for other in others):
            raise ValueError(f"others={others}: give sequences as long as {sequence!r}")
        later = [] if then is None else [self._later()]
        self.targets = torch.tensor(rewarded + later)
        self._is_later = torch.tensor([False] * len(rewarded) + [True] * len(later))
        SIZE.check("reward", reward)
        DURATION.check("duration", duration)
        self.steps = round(duration / dt)
        if self.steps < 1:
            raise ValueError(f"duration={duration} is shorter than a step: give at least dt={dt}")

    def __repr__(self) -> str:
        names = "sequence", "colors", "reward", "duration", "dt", "others", "then"
        return f"SequenceTask({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def _later(self) -> list[int]:
        """The sequence of ``then`` as positions."""
        then = self.then
        if not isinstance(then, (tuple, list)) or len(then) != 2:
            raise ValueError(f"then={shown(then)}: give (sequence, step) or None")
        sequence, step = then
        try:
            positions = indices(sequence, self.colors)
        except ValueError as error:
            raise ValueError(f"then={shown(then)}: {error}") from error
        if len(positions) != len(self.sequence):
            raise ValueError(f"then={shown(then)}: give a sequence as long as {self.sequence!r}")
        if step not in STEPS:
            raise ValueError(f"then={shown(then)}: give {STEPS} as its step")
        return positions

    @property
    def period(self) -> int:
        """Behaviours from one reward to the next at best: 4 for G-B-Y-R-G, whose ends overlap."""
        length = len(self.sequence)
        shifts = range(1, length)
        return next((k for k in shifts if self.sequence[k:] == self.sequence[:-k]), length)

    def to(self, device: torch.device | str | None) -> SequenceTask:
        """The same task for ``found`` on a device; ``None``: as it is."""
        moved = copy(self)
        moved.targets, moved._is_later = self.targets.to(device), self._is_later.to(device)
        return moved

    def initial(self, batch: tuple[int, ...] = ()) -> TaskState:
        recent = self.targets.new_full((*batch, len(self.sequence)), NOTHING)
        return TaskState(recent, self.targets.new_zeros(batch), self.targets.new_zeros(batch))

    def step(self, found: Tensor, state: TaskState) -> tuple[Tensor, Tensor, TaskState]:
        """One control step.

        Args:
            found: colour found in this step or ``NOTHING``, ``(*batch,)``, int64.

        Returns:
            reward ``(*batch,)``, completed ``(*batch,)`` (true in the step that completes
            the sequence, which is also the first with reward), and the next state.
        """
        found = found.unsqueeze(-1)
        shifted = torch.cat((state.recent[..., 1:], found), dim=-1)
        recent = torch.where(found == NOTHING, state.recent, shifted)
        matched = self._rewarded((recent.unsqueeze(-2) == self.targets).all(-1), state.age)
        completed = (found[..., 0] != NOTHING) & matched.any(-1)
        remaining = torch.where(completed, self.steps, state.remaining)
        reward = self.reward * (remaining > 0).to(torch.get_default_dtype())
        return reward, completed, TaskState(recent, (remaining - 1).clamp_min(0), state.age + 1)

    def progress(self, state: TaskState) -> Tensor:
        """How much of the sequence is right so far, 0 to 1, ``(*batch,)``.

        It is k / length, where the last k finds are the first k colours of the sequence; of
        several, of the one that is furthest. 1 stays from completion to the next find.

        >>> task = SequenceTask("GBYRG")
        >>> state = task.initial()
        >>> for letter in "GBG":
        ...     *_, state = task.step(torch.tensor(task.colors.index(letter)), state)
        ...     print(round(float(task.progress(state)), 1))
        0.2
        0.4
        0.2
        """
        length, recent = self.targets.shape[-1], state.recent.unsqueeze(-2)
        counts = range(1, length + 1)
        right = [(recent[..., length - k :] == self.targets[..., :k]).all(-1) for k in counts]
        right = [self._rewarded(each, state.age).any(-1) for each in right]
        share = [k / length * each.to(torch.get_default_dtype()) for k, each in zip(counts, right)]
        return torch.stack(share, -1).amax(-1)

    def _rewarded(self, matched: Tensor, age: Tensor) -> Tensor:
        """``matched``, one for each target, where the target is rewarded at ``age``."""
        if self.then is None:
            return matched
        return matched & ((age >= self.then[1]).unsqueeze(-1) == self._is_later)

"""An abstract world: behaviours that take a random time, for many agents at once.

No bodies and no images: an intention that is on long enough is fulfilled. For tests and
statistics, in torch alone.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import is_on
from dntorch.envs.task import NOTHING, SequenceTask, TaskState
from dntorch.noise import keyed_uniform


class NodesState(NamedTuple):
    target: Tensor
    """Colour that is sought or ``NOTHING``, ``(*batch,)``, int64, as all that follow."""
    duration: Tensor
    """Control steps of seeking until it comes into view."""
    sought: Tensor
    """Control steps for which it has been sought and seen."""
    absent: Tensor
    """Control steps since its intention was last on."""
    visits: Tensor
    """Number of behaviours begun."""
    task: TaskState


class NodesStep(NamedTuple):
    observation: dict[str, Tensor]
    """``match`` of each condition of satisfaction, 0 or 1, ``(*batch, n)``."""
    reward: Tensor
    """``(*batch,)``"""
    found: Tensor
    """Colour found in this step or ``NOTHING``, ``(*batch,)``, int64."""
    completed: Tensor
    """The sequence was completed in this step, ``(*batch,)``, bool."""


class NodesWorld:
    """Behaviours that take a random time, uniform between ``shortest`` and ``longest``.

    While the intention of a colour is on, its object is sought; when its time has come it is
    in view (the match of that behaviour becomes 1), and after ``dwell`` seconds in view it
    counts as found, once. When the intention goes off the match lingers as a percept does:
    without that overlap a condition of satisfaction may go off before it sustains itself.

    Args:
        task: what is rewarded.
        seed, agents: durations are drawn for (seed, agent, number of the visit); one seed for
            all, or a tensor ``(*batch,)``.
        shortest, longest: seconds until the object is in view.
        dwell, linger: seconds in view until found; seconds a match outlasts its intention.
    """

    STREAM = 2

    def __init__(
        self,
        task: SequenceTask | None = None,
        seed: int | Tensor = 0,
        agents: int | list[int] | Tensor = 0,
        shortest: float = 1.5,
        longest: float = 6.0,
        dwell: float = 0.6,
        linger: float = 0.6,
    ) -> None:
        if linger < dwell:
            raise ValueError(f"linger={linger} is shorter than dwell={dwell}: found could fail")
        if not 0 < shortest <= longest:
            raise ValueError(
                f"shortest={shortest}, longest={longest}: give 0 < shortest <= longest"
            )
        self.task = task or SequenceTask()
        self.n, dt = len(self.task.colors), self.task.dt
        self.seed, self.agents = seed, torch.as_tensor(agents)
        self.shortest, self.longest = shortest / dt, longest / dt
        self.dwell, self.linger = round(dwell / dt), round(linger / dt)

    def initial(self) -> NodesState:
        none = torch.zeros_like(self.agents)
        task = self.task.initial(tuple(self.agents.shape))
        return NodesState(none + NOTHING, none, none, none, none, task)

    def step(self, intention: Tensor, state: NodesState) -> tuple[NodesStep, NodesState]:
        """One control step under the firing rates of the intentions, ``(*batch, n)``.

        Raises:
            ValueError: intentions of another number or batch.
        """
        if intention.shape != (*state.target.shape, self.n):
            raise ValueError(
                f"intention of shape {list(intention.shape)} does not fit "
                f"{[*state.target.shape, self.n]}: number the agents of the batch and name as many "
                "colors as the agent has behaviors"
            )
        strongest, choice = intention.max(-1)
        on = is_on(strongest)
        begun = on & (choice != state.target)
        target = torch.where(begun, choice, state.target)
        visits = state.visits + begun
        duration = self.renew(begun, visits, state.duration)
        on = on & (choice == target)
        absent = torch.where(on, 0, state.absent + 1)
        sought = torch.where(begun, 0, state.sought) + (absent <= self.linger)
        in_view = (sought > duration) & (absent <= self.linger) & (target != NOTHING)
        found = torch.where(in_view & (sought == duration + self.dwell), target, NOTHING)
        colors = torch.arange(self.n, device=target.device)
        match = in_view.unsqueeze(-1) & (target.unsqueeze(-1) == colors)
        reward, completed, task = self.task.step(found, state.task)
        return (
            NodesStep({"match": match.to(intention.dtype)}, reward, found, completed),
            NodesState(target, duration, sought, absent, visits, task),
        )

    def renew(self, begun: Tensor, visits: Tensor, duration: Tensor) -> Tensor:
        """Durations, drawn anew where a visit has begun."""
        if not begun.any():
            return duration
        return torch.where(begun, self.draw(visits), duration)

    def draw(self, visits: Tensor) -> Tensor:
        """Steps until the object of a visit is in view."""
        share = keyed_uniform(self.seed, self.agents, visits, 1, self.STREAM)[..., 0]
        return (self.shortest + share * (self.longest - self.shortest)).round().to(torch.int64)

"""An abstract world: behaviours that take a random time, for many agents at once.

No bodies and no images: an intention that is on long enough is fulfilled. For tests and
statistics, in torch alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import is_on
from dntorch.envs.senses import check_senses
from dntorch.envs.task import NOTHING, SequenceTask, TaskState
from dntorch.envs.world import Outcome, World, check_action, individuals
from dntorch.noise import keyed_uniform
from dntorch.quantities import Interval, check_kind, shown

AHEAD = 32
"""Visits whose durations are drawn ahead."""
SPAN = Interval(0, 3600, unit="s")


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
    ahead: Tensor
    """Durations of the visits from number ``first`` on, ``(*batch, AHEAD)``."""
    first: Tensor
    seed: Tensor
    agent: Tensor
    """Whose durations these are: they are drawn for (seed, agent, number of the visit)."""
    task: TaskState


class NodesWorld(World[NodesState]):
    """Behaviours that take a random time, uniform between ``shortest`` and ``longest``.

    While the intention of a colour is on, its object is sought; when its time has come it is
    in view (the match of that behaviour becomes 1), and after ``dwell`` seconds in view it
    counts as found, once. When the intention goes off the match lingers as a percept does:
    without that overlap a condition of satisfaction may go off before it sustains itself.

    The action is the firing rates of the intentions, ``(*batch, n)``.

    ============ ================ ======================================================
    observation  shape            meaning
    ============ ================ ======================================================
    match        ``(*batch, n)``  0 or 1 for each condition of satisfaction
    lamp         ``(*batch, 1)``  ``task.progress``, 0 to 1
    ============ ================ ======================================================

    A compiled `step` draws nothing: call `provide` at the latest when `due`.

    Args:
        task: what is rewarded.
        shortest, longest: seconds until the object is in view.
        dwell, linger: seconds in view until found; seconds a match outlasts its intention.
        device: of its tensors.
        senses: names in the observation; what is not named is not computed.
        feasible: whether a behaviour is possible after the one that was found last, bool
            ``[behaviour, found last]``, ``(n, n)`` or ``(*batch, n, n)``. What is sought in vain
            does not come into view, and its time stands still. Before the first find a behaviour
            is possible that is so after any other. ``None``: all are, always.

    Raises:
        ValueError: times that make no world, another sense, ``feasible`` of another size or kind.

    >>> world = NodesWorld()
    >>> state = world.initial(agents=torch.arange(3))  # three agents with fates of their own
    >>> outcome, state = world.step(torch.zeros(3, 4), state)
    >>> outcome.found.tolist()
    [-1, -1, -1]
    """

    STREAM = 2

    def __init__(
        self,
        task: SequenceTask | None = None,
        shortest: float = 1.5,
        longest: float = 6.0,
        dwell: float = 0.6,
        linger: float = 0.6,
        device: torch.device | str | None = None,
        senses: Sequence[str] = ("match",),
        feasible: Tensor | None = None,
    ) -> None:
        for name, value in {
            "shortest": shortest, "longest": longest, "dwell": dwell, "linger": linger
        }.items():  # fmt: skip
            SPAN.check(name, value)
        if linger < dwell:
            raise ValueError(f"linger={linger} is shorter than dwell={dwell}: found could fail")
        if not 0 < shortest <= longest:
            raise ValueError(
                f"shortest={shortest}, longest={longest}: give 0 < shortest <= longest"
            )
        task = SequenceTask() if task is None else task
        check_kind("task", task, SequenceTask)
        check_senses(senses, ("match", "lamp"))
        self.task, self.device, self.senses = task.to(device), device, tuple(senses)
        self.feasible = None if feasible is None else _first_too(feasible, self.n).to(device)
        dt = self.task.dt
        self.shortest, self.longest = shortest / dt, longest / dt
        self.dwell, self.linger = round(dwell / dt), round(linger / dt)

    @property
    def actions(self) -> tuple[int, float, float]:
        return self.n, 0.0, 1.0

    def initial(
        self, batch: tuple[int, ...] = (), seed: int | Tensor = 0, agents: int | Tensor = 0
    ) -> NodesState:
        """Nothing is sought; ``seed`` and ``agents``, one for all or ``(*batch,)``, key chance."""
        seed, agents = (x.to(self.device) for x in individuals(batch, seed, agents))
        tables = () if self.feasible is None else self.feasible.shape[:-1]
        if tables not in ((), agents.shape):
            raise ValueError(
                f"feasible of batch {list(tables)} does not fit batch={list(agents.shape)}: give "
                f"[{self.n}, {self.n}] for all, or a table for each agent"
            )
        none = torch.zeros_like(agents)
        ahead = none.unsqueeze(-1).expand(*none.shape, AHEAD).clone()
        task = self.task.initial(tuple(none.shape))
        numbers = [none.clone() for _ in range(5)]
        state = NodesState(none + NOTHING, *numbers[:4], ahead, numbers[4], seed, agents, task)
        return self.provide(state)

    def observe(self, state: NodesState) -> dict[str, Tensor]:
        return self._show(state, torch.get_default_dtype())

    def step(self, intention: Tensor, state: NodesState) -> tuple[Outcome, NodesState]:
        """One control step under the firing rates of the intentions, ``(*batch, n)``.

        Raises:
            ValueError: intentions of another number or batch.
        """
        fit = "name as many colors as the agent has behaviors"
        check_action("intention", intention, state.target.shape, self.n, fit)
        if not torch.compiler.is_compiling() and self.due(state, 1):
            state = self.provide(state)
        strongest, choice = intention.max(-1)
        on = is_on(strongest)
        begun = on & (choice != state.target)
        target = torch.where(begun, choice, state.target)
        visits = state.visits + begun
        row = (visits - state.first).clamp(0, AHEAD - 1).unsqueeze(-1)
        duration = torch.where(begun, state.ahead.gather(-1, row).squeeze(-1), state.duration)
        on = on & (choice == target)
        absent = torch.where(on, 0, state.absent + 1)
        sought = torch.where(begun, 0, state.sought)
        running = absent <= self.linger
        if self.feasible is not None:  # what is in view stays there
            running = running & (self._possible(target, state.task) | (sought > duration))
        sought = sought + running
        state = state._replace(
            target=target, duration=duration, sought=sought, absent=absent, visits=visits
        )
        counts = self._in_view(state) & (sought == duration + self.dwell)
        found = torch.where(counts, target, NOTHING)
        reward, completed, task = self.task.step(found, state.task)
        state = state._replace(task=task)
        return Outcome(self._show(state, intention.dtype), reward, found, completed), state

    def again(self, first: NodesState, last: NodesState) -> NodesState:
        """Visits are counted on, so that the durations are others."""
        return self.provide(first._replace(visits=last.visits))

    def due(self, state: NodesState, steps: int = AHEAD // 2) -> bool:
        return bool((state.visits + steps - state.first >= AHEAD).any())

    def _in_view(self, state: NodesState) -> Tensor:
        near = (state.sought > state.duration) & (state.absent <= self.linger)
        return near & (state.target != NOTHING)

    def _possible(self, target: Tensor, task: TaskState) -> Tensor:
        """Whether the target can be found after what was found last."""
        last = task.recent[..., -1].remainder(self.n + 1)  # nothing: the last column
        entry = target.clamp_min(0) * (self.n + 1) + last
        table = self.feasible.expand(*target.shape, self.n * (self.n + 1))
        return table.gather(-1, entry.unsqueeze(-1)).squeeze(-1)

    def _show(self, state: NodesState, dtype: torch.dtype) -> dict[str, Tensor]:
        return {name: self._sense(name, state, dtype) for name in self.senses}

    def _sense(self, name: str, state: NodesState, dtype: torch.dtype) -> Tensor:
        if name == "lamp":
            return self.task.progress(state.task).unsqueeze(-1).to(dtype)
        colors = torch.arange(self.n, device=state.target.device)
        seen = self._in_view(state).unsqueeze(-1) & (state.target.unsqueeze(-1) == colors)
        return seen.to(dtype)

    def provide(self, state: NodesState) -> NodesState:
        """The same state with the durations of the next `AHEAD` visits drawn."""
        who = [number.unsqueeze(-1) for number in (state.seed, state.agent)]
        visits = state.visits.unsqueeze(-1) + torch.arange(AHEAD, device=state.visits.device)
        share = keyed_uniform(*who, visits, 1, self.STREAM)[..., 0]
        steps = self.shortest + share * (self.longest - self.shortest)
        return state._replace(ahead=steps.round().to(torch.int64), first=state.visits.clone())

    def snapshot(self, state: NodesState) -> list[Tensor]:
        return super().snapshot(self.provide(state))  # whenever chance was drawn last


def _first_too(feasible: Tensor, n: int) -> Tensor:
    """``feasible``, flat, with a column for the time before the first find: ``n * (n + 1)``."""
    given = isinstance(feasible, Tensor) and feasible.dtype == torch.bool
    if not given or feasible.shape[-2:] != (n, n):
        value = list(feasible.shape) if isinstance(feasible, Tensor) else shown(feasible)
        raise ValueError(
            f"feasible={value}: give a bool tensor of shape [{n}, {n}] or [*batch, {n}, {n}]"
        )
    after_another = feasible & ~torch.eye(n, dtype=torch.bool, device=feasible.device)
    return torch.cat((feasible, after_another.any(-1, keepdim=True)), -1).flatten(-2)

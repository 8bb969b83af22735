"""The worlds as TorchRL environments."""

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torch.utils import _pytree as pytree
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase, GymWrapper, InitTracker, TransformedEnv
from torchrl.envs.gym_like import default_info_dict_reader

from dntorch.envs.task import NOTHING
from dntorch.envs.world import World, individuals
from dntorch.quantities import shown
from dntorch.rl.transforms import AgentPrimer, LastReward, Report, Resumable


class WorldEnv(EnvBase):
    """Any pure world of tensors, natively batched: one agent in each member of the batch.

    ============  ==================  =======================================================
    key           shape, dtype        meaning
    ============  ==================  =======================================================
    action        ``(*batch, k)``     as the world wants it: intentions, or wheel speeds
    *its senses*  ``(*batch, ...)``   ``match``, ``image``, ``wheels``, ...
    found         ``(*batch,)`` int64  colour found in this step, or -1
    completed     ``(*batch,)`` bool  the sequence was completed in this step
    reward        ``(*batch, 1)``
    ============  ==================  =======================================================

    It never ends; for episodes insert TorchRL's ``StepCounter``. What a new episode has of the
    last one says ``world.again``; ``set_seed`` begins again.

    Args:
        world: such as `NodesWorld` or `RingWorld`.
        batch: of the agents; by default that of ``seed`` and ``agents``.
        seed, agents: of each agent, int or ``(*batch,)``, as in ``world.initial``.
        device: of all tensors.
    """

    def __init__(
        self,
        world: World,
        batch: tuple[int, ...] = (),
        seed: int | Tensor = 0,
        agents: int | Tensor = 0,
        device: torch.device | str = "cpu",
    ) -> None:
        if not isinstance(world, World) or not world.pure:
            raise ValueError(f"world={type(world).__name__} is no pure world: use wrap(env)")
        seed, agents = individuals(batch, seed, agents)
        super().__init__(batch_size=agents.shape, device=torch.device(device))
        self.world, self.seeds, self.agents = world, seed.to(device), agents.to(device)
        self.state = self._first()
        batch, (count, low, high) = tuple(agents.shape), world.actions
        self.action_spec = Bounded(low, high, (*batch, count), device, torch.float32)
        shown = {name: _seen(value) for name, value in world.observe(self.state).items()}
        self.observation_spec = Composite(
            **shown,
            found=Bounded(-1, world.n - 1, batch, device, torch.int64),
            completed=_flag(batch),
            shape=batch,
            device=device,
        )
        self.reward_spec = Unbounded((*batch, 1), device=device)

    def _first(self) -> Any:
        return self.world.initial(tuple(self.agents.shape), self.seeds, self.agents)

    def _show(self, seen: dict[str, Tensor], found: Tensor, completed: Tensor, **others):
        content = {**seen, "found": found, "completed": completed, **others}
        return TensorDict(content, batch_size=self.batch_size, device=self.device)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        fresh = self.world.again(self._first(), self.state)
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is not None:
            where = mask.squeeze(-1)

            def pick(new: Tensor, old: Tensor) -> Tensor:
                return torch.where(
                    where.reshape(where.shape + (1,) * (new.dim() - where.dim())), new, old
                )

            fresh = pytree.tree_map(pick, fresh, self.state)
        self.state = fresh
        nothing = torch.full_like(self.agents, NOTHING)
        return self._show(self.world.observe(fresh), nothing, nothing > 0)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        outcome, self.state = self.world.step(tensordict.get("action"), self.state)
        never = torch.zeros((*self.batch_size, 1), dtype=torch.bool, device=self.device)
        return self._show(
            outcome.observation,
            outcome.found,
            outcome.completed,
            reward=outcome.reward.unsqueeze(-1),
            done=never,
            terminated=never.clone(),
        )

    def _set_seed(self, seed: int | None) -> None:
        seeds = self.seeds if seed is None else torch.full_like(self.seeds, seed)
        self.state = self.world.initial(tuple(self.agents.shape), seeds, self.agents)
        self.seeds = seeds

    def state_dict(self, *_: Any, **__: Any) -> dict[str, Any]:
        """A snapshot of the world."""
        return {"seeds": self.seeds, "state": self.world.snapshot(self.state)}

    def load_state_dict(self, state: dict[str, Any], *_: Any, **__: Any) -> None:
        """Go on from a snapshot.

        Raises:
            ValueError: it is of another world or batch; the env is as it was.
        """
        if "seeds" not in state or "state" not in state:
            raise ValueError(
                f"state has {list(state)}: give what state_dict() of a WorldEnv returned"
            )
        restored = self.world.restore(state["state"], self.state)
        self.seeds, self.state = state["seeds"], restored


def _seen(value: Tensor) -> Unbounded | Bounded:
    if value.dtype == torch.uint8:
        return Bounded(0, 255, value.shape, value.device, torch.uint8)
    return Unbounded(value.shape, value.device, value.dtype)


def _flag(batch: tuple[int, ...] = ()) -> Categorical:
    return Categorical(2, shape=batch, dtype=torch.bool)


def wrap(env: Any, primer: AgentPrimer | None = None, **info: Any) -> TransformedEnv:
    """Any Gymnasium env of this library, simulated or hardware, with what `AgentPolicy` needs.

    ``info`` names entries of the info dictionary to record, with their specs. An env that
    wants to be told what the agent has found (it has ``report``) is told.
    """
    wrapped = GymWrapper(env)
    if info:
        wrapped.set_info_dict_reader(default_info_dict_reader(list(info), Composite(info)))
    made = transformed(wrapped, primer)
    return made.insert_transform(0, Report()) if hasattr(env.unwrapped, "report") else made


def transformed(env: EnvBase, primer: AgentPrimer | None = None) -> TransformedEnv:
    """A TorchRL env, such as `WorldEnv`, with what `AgentPolicy` needs.

    ``primer``, of ``policy.primer()``, carries the state of an agent in the tensordict.
    """
    if not isinstance(env, EnvBase):
        raise ValueError(f"env={shown(env)} is no TorchRL env: use wrap(env)")
    env = TransformedEnv(env, InitTracker())
    env.append_transform(LastReward())
    if primer is not None:
        env.append_transform(primer)
    return env.append_transform(Resumable())

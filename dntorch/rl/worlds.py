"""Pure worlds as TorchRL environments, natively batched and on any device."""

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torch.utils import _pytree as pytree
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from dntorch.envs.world import PureWorld


class WorldEnv(EnvBase):
    """A pure world, one agent in each member of the batch.

    ========= ======================= ====================================================
    key       shape, dtype            meaning
    ========= ======================= ====================================================
    action    ``(*batch, actions)``   as the world's `step` takes it
    *senses*  ``(*batch, ...)``       observations by name, as the world shows them
    found     ``(*batch,)`` int64     colour found in this step, or -1
    completed ``(*batch,)`` bool      the sequence was completed in this step
    reward    ``(*batch, 1)``
    ========= ======================= ====================================================

    It never ends; for episodes insert TorchRL's ``StepCounter``. A partial reset begins anew
    for the agents that are named.

    Args:
        world: what steps.
        batch: shape of the batch of agents.
        seed, agents: as of the world's ``initial``; tensors ``(*batch,)`` give each its own.
    """

    def __init__(
        self,
        world: PureWorld,
        batch: Sequence[int] = (),
        seed: int | Tensor = 0,
        agents: int | Tensor = 0,
    ) -> None:
        self.world, self.seed, self.agents = world, seed, agents
        device = getattr(world, "device", None)
        super().__init__(batch_size=list(batch), device=device)
        self.state = self._start()
        shape, kind = (*batch, world.actions), {"device": device}
        self.action_spec = Bounded(*world.action_range, shape, dtype=torch.float32, **kind)
        shown = {name: _spec(value) for name, value in world.observe(self.state).items()}
        self.observation_spec = Composite(
            **shown,
            found=Bounded(-1, world.n - 1, tuple(batch), dtype=torch.int64, **kind),
            completed=Categorical(2, shape=tuple(batch), dtype=torch.bool, **kind),
            shape=tuple(batch),
            **kind,
        )
        self.reward_spec = Unbounded((*batch, 1), **kind)

    def _start(self) -> Any:
        return self.world.initial(list(self.batch_size), self.seed, self.agents)

    def _show(self, observation: dict[str, Tensor], found: Tensor, completed: Tensor, **others):
        content = {**observation, "found": found, "completed": completed, **others}
        return TensorDict(content, batch_size=self.batch_size, device=self.device)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        fresh = self._start()
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is not None:
            where = mask.squeeze(-1)

            def pick(new: Tensor, old: Tensor) -> Tensor:
                more = (1,) * (new.dim() - where.dim())
                return torch.where(where.reshape(where.shape + more), new, old)

            fresh = pytree.tree_map(pick, fresh, self.state)
        self.state = fresh
        found = self.observation_spec["found"].zero() - 1
        return self._show(self.world.observe(self.state), found, found >= 0)

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
        if seed is not None:
            self.seed = seed
        self.state = self._start()

    def state_dict(self, *_: Any, **__: Any) -> dict[str, Any]:
        """A snapshot of the world."""
        return {"seed": self.seed, "state": pytree.tree_leaves(self.state)}

    def load_state_dict(self, state: dict[str, Any], *_: Any, **__: Any) -> None:
        self.seed = state["seed"]
        structure = pytree.tree_structure(self.state)
        self.state = pytree.tree_unflatten(state["state"], structure)


def _spec(value: Tensor) -> Bounded | Unbounded:
    kind = {"device": value.device, "dtype": value.dtype}
    if value.dtype == torch.uint8:
        return Bounded(0, 255, value.shape, **kind)
    return Unbounded(value.shape, **kind)

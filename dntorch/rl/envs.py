"""The worlds as TorchRL environments."""

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torch.utils import _pytree as pytree
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase, GymWrapper, InitTracker, TransformedEnv
from torchrl.envs.gym_like import default_info_dict_reader

from dntorch.envs.nodes import NodesWorld
from dntorch.rl.transforms import AgentPrimer, LastReward, Report, Resumable
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.worlds import build_epuck, build_task


class NodesEnv(EnvBase):
    """The abstract world, natively batched: one agent in each member of the batch.

    ========  ==================  ===========================================================
    key       shape, dtype        meaning
    ========  ==================  ===========================================================
    action    ``(*batch, n)``     firing rate of each intention
    match     ``(*batch, n)``     match of each condition of satisfaction
    found     ``(*batch,)`` int64  colour found in this step, or -1
    completed ``(*batch,)`` bool  the sequence was completed in this step
    reward    ``(*batch, 1)``
    ========  ==================  ===========================================================

    It never ends; for episodes insert TorchRL's ``StepCounter``. Durations are drawn for
    (seed, agent, number of the visit), and visits are counted on over resets:
    ``set_seed`` begins again.
    """

    def __init__(self, world: NodesWorld | None = None) -> None:
        self.world = world or NodesWorld()
        batch, n = self.world.agents.shape, self.world.n
        super().__init__(batch_size=batch)
        self.state = self.world.initial()
        rate = Bounded(0.0, 1.0, (*batch, n), dtype=torch.float32)
        self.action_spec = rate
        self.observation_spec = Composite(
            match=rate.clone(),
            found=Bounded(-1, n - 1, batch, dtype=torch.int64),
            completed=_flag(batch),
            shape=batch,
        )
        self.reward_spec = Unbounded((*batch, 1))

    def _show(self, match: Tensor, found: Tensor, completed: Tensor, **others) -> TensorDict:
        content = {"match": match, "found": found, "completed": completed, **others}
        return TensorDict(content, batch_size=self.batch_size)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        fresh = self.world.initial()._replace(visits=self.state.visits)
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is not None:
            where = mask.squeeze(-1)

            def pick(new: Tensor, old: Tensor) -> Tensor:
                return torch.where(
                    where.reshape(where.shape + (1,) * (new.dim() - where.dim())), new, old
                )

            fresh = pytree.tree_map(pick, fresh, self.state)
        self.state = fresh
        match = self.observation_spec["match"].zero()
        return self._show(match, self.state.target.clone().fill_(-1), match[..., 0] > 0)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        step, self.state = self.world.step(tensordict.get("action"), self.state)
        never = torch.zeros((*self.batch_size, 1), dtype=torch.bool)
        return self._show(
            step.observation["match"], step.found, step.completed,
            reward=step.reward.unsqueeze(-1), done=never, terminated=never.clone(),
        )  # fmt: skip

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self.world.seed = seed
        self.state = self.world.initial()

    def state_dict(self, *_: Any, **__: Any) -> dict[str, Any]:
        """A snapshot of the world."""
        return {"seed": self.world.seed, "state": pytree.tree_leaves(self.state)}

    def load_state_dict(self, state: dict[str, Any], *_: Any, **__: Any) -> None:
        self.world.seed = state["seed"]
        structure = pytree.tree_structure(self.state)
        self.state = pytree.tree_unflatten(state["state"], structure)


def _flag(batch: tuple[int, ...] = ()) -> Categorical:
    return Categorical(2, shape=batch, dtype=torch.bool)


def nodes(
    config: Config, primer: AgentPrimer | None = None, agents: int | Tensor = 0
) -> TransformedEnv:
    """The abstract world of a run, with what `AgentPolicy` needs; ``agents`` by number."""
    world = NodesWorld(build_task(config), config.seed, agents)
    return _transformed(NodesEnv(world), primer)


def epuck(
    config: Config,
    primer: AgentPrimer | None = None,
    max_seconds: float | None = None,
    senses: Sequence[str] | None = None,
) -> TransformedEnv:
    """The PyBullet world of a run, with what `AgentPolicy` needs.

    The layout is that of ``config.seed`` in every episode, of which there is one unless
    ``max_seconds`` cuts it. It shows ``senses``, by default what the agent of the run reads.
    Recorded beside them: ``found`` and ``completed``.
    """
    senses = build_agent(config).senses if senses is None else senses
    env = build_epuck(config, layout_seed=config.seed, max_seconds=max_seconds, senses=senses)
    return wrap(env, primer, found=Unbounded((), dtype=torch.int64), completed=_flag())


def wrap(env: Any, primer: AgentPrimer | None = None, **info: Any) -> TransformedEnv:
    """Any Gymnasium env of this library, simulated or hardware, with what `AgentPolicy` needs.

    ``info`` names entries of the info dictionary to record, with their specs. An env that
    wants to be told what the agent has found (it has ``report``) is told.
    """
    wrapped = GymWrapper(env)
    if info:
        wrapped.set_info_dict_reader(default_info_dict_reader(list(info), Composite(info)))
    made = _transformed(wrapped, primer)
    return made.insert_transform(0, Report()) if hasattr(env.unwrapped, "report") else made


def _transformed(env: EnvBase, primer: AgentPrimer | None) -> TransformedEnv:
    env = TransformedEnv(env, InitTracker())
    env.append_transform(LastReward())
    if primer is not None:
        env.append_transform(primer)
    return env.append_transform(Resumable())

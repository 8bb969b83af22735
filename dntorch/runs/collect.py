"""The world of a run as a TorchRL environment, for collectors."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torchrl.data import Categorical, Unbounded
from torchrl.envs import TransformedEnv

from dntorch.rl import AgentPrimer, WorldEnv, transformed, wrap
from dntorch.runs.build import senses_of
from dntorch.runs.config import Config
from dntorch.runs.worlds import build_world


def collected(
    config: Config,
    primer: AgentPrimer | None = None,
    senses: Sequence[str] | None = None,
    agents: int | Tensor | None = None,
) -> TransformedEnv:
    """The world of a run, with what `AgentPolicy` needs.

    Beside the observations it records ``found`` and ``completed``. There is one episode without
    end; TorchRL's ``StepCounter`` cuts it, and a PyBullet world then has the same layout again.

    Args:
        config: of the run; ``config.world`` says which world.
        primer: of ``policy.primer()``, where the tensordict carries the state of the agent.
        senses: what the world shows, by default what the agent of the run reads.
        agents: numbers of the agents in a batch, ``(*batch,)``; of a world that has batches.

    Raises:
        ValueError: senses that the world does not have; agents in a world for one agent.
    """
    senses = senses_of(config) if senses is None else tuple(senses)
    world = build_world(config, senses)
    if world.pure:
        numbers = torch.as_tensor(0 if agents is None else agents)
        return transformed(WorldEnv(world, seed=config.seed, agents=numbers), primer)
    if agents is not None:
        raise ValueError(f"agents={agents}: world={config.world!r} is for one agent, leave it out")
    flag = Categorical(2, shape=(), dtype=torch.bool)
    return wrap(world.env, primer, found=Unbounded((), dtype=torch.int64), completed=flag)

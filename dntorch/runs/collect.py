"""The world of a run as a TorchRL environment, for collectors."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torchrl.data import Categorical, Unbounded
from torchrl.envs import TransformedEnv

from dntorch.envs.nodes import NodesWorld
from dntorch.rl import AgentPrimer, NodesEnv, transformed, wrap
from dntorch.runs.config import Config, senses_of
from dntorch.runs.worlds import build_epuck, build_task


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
    if config.world == "nodes":
        if senses is not None and tuple(senses) != ("match",):
            raise ValueError(f"senses={tuple(senses)}: this world shows ('match',), leave it out")
        world = NodesWorld(build_task(config), config.seed, 0 if agents is None else agents)
        return transformed(NodesEnv(world), primer)
    if agents is not None:
        raise ValueError(f"agents={agents}: world={config.world!r} is for one agent, leave it out")
    senses = senses_of(config) if senses is None else senses
    env = build_epuck(config, layout_seed=config.seed, senses=tuple(senses))
    flag = Categorical(2, shape=(), dtype=torch.bool)
    return wrap(env, primer, found=Unbounded((), dtype=torch.int64), completed=flag)

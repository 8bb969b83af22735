"""The agent and its worlds for TorchRL: policies, environments and what carries state between.

``pip install 'dntorch[rl]'`` brings TorchRL. Nothing here trains: the agent learns on line,
inside the forward of its policy, and any collector that runs it is a training loop.
"""

from dntorch.rl.envs import NodesEnv, epuck, nodes, wrap
from dntorch.rl.policy import AgentPolicy
from dntorch.rl.transforms import AgentPrimer, LastReward, Report, Resumable
from dntorch.rl.worlds import WorldEnv

__all__ = [
    "AgentPolicy", "AgentPrimer", "LastReward", "NodesEnv", "Report", "Resumable", "WorldEnv",
    "epuck", "nodes", "wrap",
]  # fmt: skip

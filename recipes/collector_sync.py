"""Several agents in several processes: MultiSyncCollector, each worker with an agent of its own.

A policy that learns on line may not be shared: with ``policy=`` all workers would step one
agent in shared memory (`AgentPolicy` refuses). With ``policy_factory=`` each process builds its
own; what it learned comes back in the collector's state, which is written to a file halfway and
read by new processes, as after a kill. The task is short, green and then blue, so that reward
comes within minutes. You see a line a batch, then, for each worker, whether its agent equals
that of the plain loop with its seed, to the last bit. Five minutes on two cores; each process
needs some seconds to start.

    python recipes/collector_sync.py --workers 2 --steps 10000
"""

import argparse
from functools import partial
from pathlib import Path

import torch
from torchrl.collectors import MultiSyncCollector

from dntorch import files
from dntorch.process import settle
from dntorch.rl import AgentPolicy
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial


def build_policy(config: Config) -> AgentPolicy:
    """Called in the worker: process-wide settings belong here too, nothing else sets them."""
    settle()
    return AgentPolicy(build_agent(config), config.explore, build_exploration(config))


def collect(configs: list[Config], batches: int, state: dict | None = None) -> dict:
    """The state of new workers after some batches, from the ``state`` of others."""
    workers, frames = len(configs), configs[0].steps // 4
    collector = MultiSyncCollector(
        [partial(collected, config) for config in configs],
        policy_factory=[partial(build_policy, config) for config in configs],
        frames_per_batch=workers * frames,
        cat_results=0,
    )
    if state is not None:
        collector.load_state_dict(state)
    iterator = iter(collector)  # when it goes, the workers go
    for _, batch in zip(range(batches), iterator):
        found = (batch["next", "found"] >= 0).view(workers, -1).sum(1).tolist()
        print(f"step {int(batch['steps'].max())}: colours found by each {found}", flush=True)
    state = collector.state_dict()
    collector.shutdown()
    return state


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--steps", type=int, default=10_000, help="of each agent")
    parser.add_argument("--seed", type=int, default=3, help="of the first agent")
    parser.add_argument("--world", default="epuck", help="such as ring, which needs no PyBullet")
    parser.add_argument("--out", type=Path, default=Path("runs/collector_sync"))
    arguments = parser.parse_args()
    settle()
    arguments.out.mkdir(parents=True, exist_ok=True)
    steps, task = arguments.steps, {"world": arguments.world, "sequence": "GB", "colors": "GBY"}
    configs = [
        Config(seed=arguments.seed + k, steps=steps, explore=steps // 2, **task)
        for k in range(arguments.workers)
    ]

    file = arguments.out / "collector.pt"
    files.save(file, {"state": collect(configs, 2)})
    learned = collect(configs, 2, files.load(file)["state"])

    for k, config in enumerate(configs):
        policy, trial = build_policy(config), Trial(config)
        policy.load_state_dict(learned[f"worker{k}"]["policy_state_dict"])
        trial.advance(steps)
        ours, theirs = policy.agent.snapshot(), trial.agent.snapshot()  # values and activations
        equal = all(torch.equal(ours[name], theirs[name]) for name in theirs)
        print(f"seed {config.seed}: largest value {policy.agent.weights.max():.3f}, "
              f"equal to the plain loop: {equal}")  # fmt: skip


if __name__ == "__main__":
    main()

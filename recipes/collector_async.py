"""Agents that don't wait for each other: MultiAsyncCollector, state in the tensordict.

One policy object goes to all processes. It may be shared since it holds no state: with
``carried=True`` each env carries the state of its agent, primed by ``policy.primer()``, and a
batch brings what was learned. You see batches in the order in which workers finish them, then,
for each worker, whether its values equal those of the plain loop with its seed, to the last
bit. Five minutes on two cores; each process needs some seconds to start.

    python recipes/collector_async.py --workers 2 --steps 10000
"""

import argparse
from functools import partial

import torch
from torchrl.collectors import MultiAsyncCollector
from torchrl.envs import EnvBase

from dntorch.experiments.config import Config, build_agent, build_exploration
from dntorch.experiments.trial import Trial
from dntorch.rl import AgentPolicy, AgentPrimer, epuck


def build_env(config: Config, primer: AgentPrimer) -> EnvBase:
    """Called in the worker: process-wide settings belong here too, nothing else sets them."""
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    return epuck(config, primer)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--steps", type=int, default=10_000, help="of each agent")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    steps, workers = arguments.steps, arguments.workers
    configs = [Config(seed=k + 1, steps=steps, explore=steps // 2) for k in range(workers)]

    first = configs[0]
    policy = AgentPolicy(build_agent(first), first.explore, build_exploration(first), carried=True)
    collector = MultiAsyncCollector(
        [partial(build_env, config, policy.primer(config.seed)) for config in configs],
        policy,
        frames_per_batch=steps // 5,
        auto_register_policy_transforms=False,
    )
    learned = {}
    for batch in collector:
        seed, reached = int(batch["agent", "seed"][0]), int(batch["steps"][-1])
        found = int((batch["next", "found"] >= 0).sum())
        print(f"seed {seed}, step {reached}: found {found} colours", flush=True)
        if reached == steps:
            learned[seed] = batch[-1:].clone()
        if len(learned) == workers:
            break
    collector.shutdown()

    for config in configs:
        agent, trial = policy.adopt(learned[config.seed]), Trial(config)
        trial.advance(steps)
        ours, theirs = agent.snapshot(), trial.agent.snapshot()  # values and activations
        equal = all(torch.equal(ours[name], theirs[name]) for name in theirs)
        print(f"seed {config.seed}: largest value {agent.weights.max():.3f}, "
              f"equal to the plain loop: {equal}")  # fmt: skip


if __name__ == "__main__":
    main()

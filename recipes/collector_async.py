"""Agents that don't wait for each other: MultiAsyncCollector, state in the tensordict.

One policy object goes to all processes. It may be shared since it holds no state: with
``carried=True`` each env carries the state of its agent, primed by ``policy.primer()``, and a
batch brings what was learned. The collector's state is written to a file halfway and read by
new processes, as after a kill: workers that had gone on meanwhile are then where they were, and
batches of theirs that nobody had taken yet don't come again. The task is short, green and then
blue, so that reward comes within minutes. You see batches in the order in which workers finish
them, then, for each worker, whether its agent equals that of the plain loop with its seed, to
the last bit. Five minutes on two cores; each process needs some seconds to start.

    python recipes/collector_async.py --workers 2 --steps 10000
"""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from tensordict import TensorDict
from torchrl.collectors import MultiAsyncCollector
from torchrl.envs import EnvBase

from dntorch import files
from dntorch.process import settle
from dntorch.rl import AgentPolicy, AgentPrimer
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial


def build_env(config: Config, primer: AgentPrimer) -> EnvBase:
    """Called in the worker: process-wide settings belong here too, nothing else sets them."""
    settle()
    return collected(config, primer)


def collect(policy, configs: list[Config], until: int, state=None) -> tuple[dict, TensorDict]:
    """The state of new workers when all have come to step ``until``, and their last steps."""
    collector = MultiAsyncCollector(
        [partial(build_env, config, policy.primer(config.seed)) for config in configs],
        policy,
        frames_per_batch=configs[0].steps // 4,
        auto_register_policy_transforms=False,
    )
    if state is not None:
        collector.load_state_dict(state)
    last: dict[int, TensorDict] = {}
    batches = iter(collector)  # when it goes, the workers go
    while len(last) < len(configs):
        batch = next(batches)
        seed, reached = int(batch["agent", "seed"][0]), int(batch["steps"][-1])
        found = int((batch["next", "found"] >= 0).sum())
        print(f"seed {seed}, step {reached}: found {found} colours", flush=True)
        if reached >= until:
            last[seed] = batch[-1:].clone()
    state = collector.state_dict()
    collector.shutdown()
    return state, last


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--steps", type=int, default=10_000, help="of each agent")
    parser.add_argument("--seed", type=int, default=3, help="of the first agent")
    parser.add_argument("--world", default="epuck", help="such as ring, which needs no PyBullet")
    parser.add_argument("--out", type=Path, default=Path("runs/collector_async"))
    arguments = parser.parse_args()
    settle()
    arguments.out.mkdir(parents=True, exist_ok=True)
    steps, task = arguments.steps, {"world": arguments.world, "sequence": "GB", "colors": "GBY"}
    configs = [
        Config(seed=arguments.seed + k, steps=steps, explore=steps // 2, **task)
        for k in range(arguments.workers)
    ]

    first = configs[0]
    policy = AgentPolicy(build_agent(first), first.explore, build_exploration(first), carried=True)
    file = arguments.out / "collector.pt"
    files.save(file, {"state": collect(policy, configs, steps // 2)[0]})
    learned = collect(policy, configs, steps, files.load(file)["state"])[1]

    for config in configs:
        batch = learned[config.seed]
        reached = int(batch["steps"][-1])
        agent, trial = policy.adopt(batch), Trial(replace(config, steps=reached))
        trial.advance(reached)
        ours, theirs = agent.snapshot(), trial.agent.snapshot()  # values and activations
        equal = all(torch.equal(ours[name], theirs[name]) for name in theirs)
        print(f"seed {config.seed}: largest value {agent.weights.max():.3f}, "
              f"equal to the plain loop: {equal}")  # fmt: skip


if __name__ == "__main__":
    main()

"""The agent learns inside a TorchRL Collector, from camera images, with checkpoints.

The plain loop of `dntorch learn` and a collector are the same experiment: this recipe runs both
with one seed, writes the collector's state to a file halfway, goes on in a new collector as a
program that was killed would, and says whether the two agents end up equal to the last bit. A
tenth of the paper's run by default: a minute on one core; the whole with --steps 100000.

    python recipes/collector.py --steps 10000 --seed 1
"""

import argparse
from pathlib import Path

import torch
from torchrl.collectors import Collector

from dntorch import files
from dntorch.process import settle
from dntorch.rl import AgentPolicy
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial


def build(config: Config, frames: int) -> tuple[Collector, AgentPolicy]:
    """A new collector; it uses the very policy that it is given."""
    policy = AgentPolicy(build_agent(config), config.explore, build_exploration(config))
    options = {"frames_per_batch": frames, "total_frames": -1}
    options["track_traj_ids"] = False  # one, without end; a tenth of what a collector adds
    return Collector(collected(config), policy, **options), policy


def collect(collector: Collector, batches: int) -> None:
    for _, batch in zip(range(batches), collector):
        found = int((batch["next", "found"] >= 0).sum())
        completed = int(batch["next", "completed"].sum())
        print(f"step {int(batch['steps'][-1])}: found {found} colours, the sequence {completed} "
              "times", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/collector"))
    arguments = parser.parse_args()
    settle()
    arguments.out.mkdir(parents=True, exist_ok=True)
    config = Config(seed=arguments.seed, steps=arguments.steps, explore=arguments.steps // 2)
    frames = config.steps // 10

    collector, _ = build(config, frames)
    collect(collector, 5)
    files.save(arguments.out / "collector.pt", {"state": collector.state_dict()})
    collector.shutdown()

    collector, policy = build(config, frames)
    collector.load_state_dict(files.load(arguments.out / "collector.pt")["state"])
    collect(collector, 5)
    collector.shutdown()

    trial = Trial(config)
    trial.advance(10 * frames)
    ours, theirs = policy.agent.snapshot(), trial.agent.snapshot()  # values and activations
    equal = all(torch.equal(ours[name], theirs[name]) for name in theirs)
    print(f"values [state][action], largest {policy.agent.weights.max():.3f}:")
    print(policy.agent.weights.t())
    print(f"equal to the plain loop: {equal}")


if __name__ == "__main__":
    main()

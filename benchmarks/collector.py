"""Cost of a control step through TorchRL's Collector, as a ratio to the plain loop.

    python benchmarks/collector.py [--rounds 60] [--steps 25]

On camera images of the PyBullet world, and in the abstract world where next to nothing but the
overhead is left. Plain loop and collectors take turns in one run on one thread and both record
what happened. Prints the median CPU time of a control step, and the median over the turns of its
ratio to the plain loop in the same turn, with the middle half of them. Half a minute.
"""

import argparse
import statistics
import time

from torchrl.collectors import Collector

from dntorch.process import settle
from dntorch.rl import AgentPolicy
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial


def collector(config: Config, frames: int, carried: bool = False, **options):
    agent, exploration = build_agent(config), build_exploration(config)
    policy = AgentPolicy(agent, config.explore, exploration, carried)
    env = collected(config, policy.primer() if carried else None)
    batches = iter(Collector(env, policy, frames_per_batch=frames, total_frames=-1, **options))
    return lambda: next(batches)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--steps", type=int, default=25, help="in each turn")
    arguments = parser.parse_args()
    settle()
    frames = arguments.steps
    for world in ("epuck", "nodes"):
        config = Config(world=world)
        trial = Trial(config)
        ways = {
            "plain loop": lambda trial=trial: trial.advance(frames),
            "state in buffers": collector(config, frames),
            "without trajectory ids": collector(config, frames, track_traj_ids=False),
            "state in the tensordict": collector(config, frames, carried=True),
        }
        times: dict[str, list[float]] = {name: [] for name in ways}
        for turn in range(arguments.rounds + 2):
            for name, way in ways.items():
                began = time.process_time()
                way()
                if turn >= 2:
                    times[name].append((time.process_time() - began) / frames)
        print(f"{world}: CPU time of a control step")
        for name, seconds in times.items():
            ratios = [x / plain for x, plain in zip(seconds, times["plain loop"])]
            low, middle, high = statistics.quantiles(ratios, n=4)
            print(f"  {name:24} {1e6 * statistics.median(seconds):7.0f} us {middle:6.2f} x "
                  f"[{low:.2f}, {high:.2f}]")  # fmt: skip


if __name__ == "__main__":
    main()

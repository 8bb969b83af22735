"""The PyBullet loop of `dntorch learn` against the env alone, and the ring beside both.

    python benchmarks/loop.py [--rounds 9] [--steps 100]

Agent and world learn step by step, as in `dntorch learn`, eager and compiled; the env alone takes
as many steps with the same observations; runs of the ring take them as one batch per process.
All take turns in one run on one thread. Prints the median CPU time of an agent-step, and its
ratio to the env's step in the same turn with the middle half of the ratios. Two minutes.
"""

import argparse
import os
import time

import numpy as np

from dntorch.process import can_compile, settle
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.run import Run, Trial


def ways(steps: int) -> dict:
    """What takes turns: a function that takes ``steps`` steps, and agents that do."""
    config = Config(seed=1)
    eager = Trial(config)
    env = eager.world.env
    turn = np.array([0.3, -0.3])

    def alone() -> None:
        for _ in range(steps):
            env.step(turn)

    each = {"env alone": (alone, 1), "learn, eager": (lambda: eager.advance(steps), 1)}
    if not can_compile():
        return each
    compiled = Trial(config, compiled=True)
    each["learn, compiled"] = (lambda: compiled.advance(steps), 1)
    for batch in (64, 1024):
        group = Group(Config(world="ring", seed=1), seeds=tuple(range(batch)))
        ring, part = Run(group, events=True, compiled=True), max(1, steps * 8 // batch)
        each[f"ring, batch {batch}"] = (
            lambda ring=ring, n=part: ring.advance(n),
            batch * part / steps,
        )
    return each


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=100)
    arguments = parser.parse_args()
    settle()
    each = ways(arguments.steps)
    for step, _ in each.values():
        step()  # compiles
    times: dict[str, list[float]] = {name: [] for name in each}
    for _ in range(arguments.rounds):
        for name, (step, agents) in each.items():
            began = time.process_time()
            step()
            times[name].append((time.process_time() - began) / arguments.steps / agents)
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores, {arguments.rounds} rounds")
    base = np.array(times["env alone"])
    for name, seconds in times.items():
        low, middle, high = np.percentile(np.array(seconds) / base, (25, 50, 75))
        spread = f"({low:.3f} to {high:.3f})"
        print(f"{name:18} {1e6 * np.median(seconds):9.1f} us  {middle:7.3f} x {spread}")


if __name__ == "__main__":
    main()

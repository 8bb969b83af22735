"""`dntorch learn` from its first step to its report, against the env's steps alone.

    python benchmarks/learn.py [--steps 100000] [--rounds 1] [--world epuck]

Whole processes that take turns: the command as a user types it, and as many steps of the same env
with the same observations. The first line of each round is learned with an empty cache of the
compiler, the second with a full one. Prints wall-clock seconds and their ratio. Fifteen minutes.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from harness import machine

ALONE = """
import numpy as np
from dntorch.process import settle
from dntorch.runs.config import Config
from dntorch.runs.run import Trial
settle()
env, turn = Trial(Config(world={world!r}, seed=1)).world.env, np.array([0.3, -0.3])
for _ in range({steps}):
    env.step(turn)
"""


def seconds(command: list[str], cache: Path) -> float:
    began = time.monotonic()
    environment = os.environ | {"TORCHINDUCTOR_CACHE_DIR": str(cache)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command[:4])} failed: {done.stderr.strip()}")
    return time.monotonic() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--world", default="epuck")
    arguments = parser.parse_args()
    steps, world = arguments.steps, arguments.world
    learn = [sys.executable, "-m", "dntorch", "learn", "--world", world, "--steps", str(steps)]
    learn += ["--explore", str(steps // 2), "--out"]
    alone = [sys.executable, "-c", ALONE.format(world=world, steps=steps)]
    print(f"{steps} steps in {world}\n  {machine()}")
    for k in range(arguments.rounds):
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(folder, "cache")
            cold = seconds([*learn, str(Path(folder, "cold"))], cache)
            env = seconds(alone, cache)
            warm = seconds([*learn, str(Path(folder, "warm"))], cache)
            again = seconds(alone, cache)
        middle = (env + again) / 2
        print(f"  round {k + 1}: env alone {env:.1f} and {again:.1f} s", flush=True)
        print(f"    learn, cold compile {cold:7.1f} s  {cold / middle:.2f} x")
        print(f"    learn, warm compile {warm:7.1f} s  {warm / middle:.2f} x", flush=True)
    print(f"  load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()

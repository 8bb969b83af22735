"""Cost of a core step against the number n of behaviours: pairs are n squared.

    python benchmarks/behaviors.py [--batch 1024] [--rounds 11]

The library's step, eager and compiled, with n = 4, 8, 16, 32 and 64; the batch shrinks as pairs
grow, so that all fit the same memory. Prints the cost of an agent-step, that per pair, and the
exponent of n over all sizes and between the last two. Two minutes.
"""

import argparse
import math
import statistics

import numpy as np
import torch
from harness import has_compiler, machine, take_turns
from library import Compiled, Modules

from dntorch.process import settle

SIZES = (4, 8, 16, 32, 64)


def inputs(n: int, batch: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """One object after another in view for each agent, a second each; no reward."""
    random = np.random.default_rng(0)
    seen = np.eye(n, dtype=np.float32)[random.integers(0, n, (-(-steps // 32), batch))]
    return np.ascontiguousarray(seen[np.arange(steps) // 32]), np.zeros((steps, batch), np.float32)


def exponent(sizes: tuple[int, ...], costs: list[float]) -> float:
    """Slope of a straight line through the logarithms."""
    x, y = [math.log(n) for n in sizes], [math.log(c) for c in costs]
    return statistics.linear_regression(x, y).slope


def measure(way: type[Modules], batch: int, rounds: int) -> None:
    steps, members = 8, {n: max(1, batch * 16 // n**2) for n in SIZES}
    runs = {str(n): way(*inputs(n, members[n], steps)) for n in SIZES}
    times = take_turns(runs, rounds)
    costs = [statistics.median(times[str(n)]) / steps / members[n] for n in SIZES]
    print(f"\n{way.__name__}, batch {batch} at n = 4\n  {machine()}")
    for n, cost in zip(SIZES, costs):
        print(f"  n {n:3} {1e6 * cost:10.3f} us {1e9 * cost / n**2:9.2f} ns per pair")
    last = exponent(SIZES[-2:], costs[-2:])
    print(f"  exponent {exponent(SIZES, costs):.2f}, from 32 to 64 {last:.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=11)
    arguments = parser.parse_args()
    settle()
    torch._dynamo.config.recompile_limit = 2 * len(SIZES)
    for way in (Modules, Compiled) if has_compiler() else (Modules,):
        measure(way, arguments.batch, arguments.rounds)


if __name__ == "__main__":
    main()

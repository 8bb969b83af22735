"""The core of the agent, without senses: cost of an agent-step as a ratio to the same in C++.

    python benchmarks/core.py [--batches 1 13 256 4096 65536] [--rounds 11]

The step is that of `DNSarsa(4)` with match, reward and noise given: behaviours, pairs, pulses,
memory, opposition, values. The floor is ``floor.cpp``: one struct per agent, float32, one thread,
steps looped inside C. The library runs eager; compiled, step by step; and as a *rollout*, a loop
over steps inside one compiled graph, both with the batch innermost in memory. NumPy, numba and
JAX write the same step again. First all must agree: after some hundred steps from the same
inputs, values to 1e-4. The last rows compare 2,000 silent steps with fresh ones. Four minutes.
"""

import argparse
import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from arrays import Arrays, Scanned, preference
from harness import address, build, has_compiler, ratios, table, take_turns
from library import Compiled, Modules, Rollout

from dntorch.process import settle


class Floor:
    """C++, one agent after the other, all it needs in registers and cache."""

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        steps, batch = reward.shape
        self.agents = np.zeros((batch, 4 + 4 + 4 + 4 * 16 + 1 + 16), np.float32)
        self.agents[:, :8] = -5
        self.held = self.agents, match, reward, np.zeros((batch, 16), np.float32), preference()
        self.run = build(Path(__file__).with_name("floor.cpp").read_text()).run
        agents, match, reward, noise, base = map(address, self.held)
        self.arguments = agents, match, reward, noise, batch, base, steps

    def __call__(self) -> None:
        self.run(*self.arguments)

    @property
    def weights(self) -> np.ndarray:
        return self.agents[:, -16:].reshape(-1, 4, 4)


def ways() -> dict[str, Callable]:
    """What can be had here; what can't is named."""
    found: dict[str, Callable] = {"eager": Modules, "NumPy": Arrays}
    if has_compiler():
        found |= {"C++": Floor, "compiled": Compiled, "rollout": Rollout}
    else:
        print("skipped: C++, compiled, rollout (no g++); ratios are to NumPy")
    if importlib.util.find_spec("numba"):
        from loops import Loops

        found["numba"] = Loops
    if importlib.util.find_spec("jax"):
        found["JAX"] = Scanned
    for name in ("numba", "JAX"):
        if name not in found:
            print(f"skipped: {name} (not installed)")
    return found


def inputs(batch: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Each second another object is in view for each agent; a reward now and then."""
    random, seconds = np.random.default_rng(0), -(-steps // 32)
    seen = np.eye(4, dtype=np.float32)[random.integers(0, 4, (seconds, batch))]
    paid = 2 * (random.random((seconds, batch)) < 0.2).astype(np.float32)
    step = np.arange(steps)
    match = seen[step // 32] * (step % 32 > 8).astype(np.float32)[:, None, None]
    return np.ascontiguousarray(match), np.ascontiguousarray(paid[step // 32])


def check(runs: dict[str, Callable], floor: str, portions: int) -> None:
    """Run some portions; raise unless all have learned the same."""
    for run in runs.values():
        for _ in range(portions):
            run()
    first = runs[floor].weights
    assert np.abs(first).max() > 0.01, "nothing was learned: nothing was compared"
    for name, run in runs.items():
        apart = (np.abs(run.weights - first).max((-2, -1)) > 1e-4).mean()
        # Near ties are decided by rounding; what follows differs for good.
        assert apart < 0.02, f"{name}: {apart:.1%} of the agents learned other values"


def compare(batch: int, found: dict[str, Callable], rounds: int) -> None:
    steps = 512 if batch == 1 else 64
    runs = {name: way(*inputs(batch, steps)) for name, way in found.items()}
    floor = "C++" if "C++" in runs else "NumPy"
    check(runs, floor, -(-384 // steps) if batch <= 4096 else 2)
    times = take_turns(runs, rounds if batch <= 4096 else min(rounds, 3))
    table(f"core, batch {batch}", times, floor, dict.fromkeys(runs, steps * batch))


def silence(batch: int, way: Callable, rounds: int) -> None:
    """Activation fades when nothing happens: numbers near 0 must cost what others do."""
    fresh, silent = (way(*inputs(batch, 64)) for _ in range(2))
    fresh()
    silent()
    for run in (fresh, silent):
        run.match, run.reward = run.match[:8].clone().zero_(), run.reward[:8] * 0
    begun = fresh.state
    for _ in range(2000 // 8):
        silent()

    def again() -> None:
        fresh.state = begun
        fresh()

    times = take_turns({"fresh": again, "silent": silent}, rounds)
    middle, low, high = ratios(times["silent"], times["fresh"])
    what = f"after 2,000 silent steps / fresh, {way.__name__}, batch {batch}"
    print(f"  {what}: {middle:.2f} ({low:.2f} to {high:.2f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 13, 256, 4096, 65536])
    parser.add_argument("--rounds", type=int, default=11)
    arguments = parser.parse_args()
    settle()
    found = ways()
    for batch in arguments.batches:
        compare(batch, found, arguments.rounds)
        torch.compiler.reset()  # each batch is a shape of its own
    for way in (Modules, Compiled) if has_compiler() else (Modules,):
        silence(4096, way, arguments.rounds)


if __name__ == "__main__":
    main()

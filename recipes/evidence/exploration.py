"""Is exploration fair, and does any number of behaviours act?

For n = 2 to 64 behaviours a batch of agents explores the abstract world for 50,000 steps, with
nothing to be learned. Prints, for each n: behaviours an agent completes (mean and least), how
often the one before last returns (chance: 1 / (n - 1)), the share of the steps in which two
intentions are on, and how many behaviours come first in a life; for n = 4 also by how much the
rarest and the commonest of the 36 triples of successive behaviours differ from their share, with
the chi-square of the choice of the third. Fifteen minutes on two idle cores; ``--steps`` shortens.

    python recipes/evidence/exploration.py --out runs/exploration
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.stats import chi2

from dntorch import DNSarsa, Exploration
from dntorch.envs.nodes import NodesWorld
from dntorch.files import write_json
from dntorch.process import commit, pays, settle
from dntorch.runs.engine import Engine
from dntorch.runs.events import Events

SIZES = {2: 16, 4: 512, 6: 64, 8: 64, 16: 64, 20: 16, 24: 16, 28: 16, 32: 16, 64: 16}
"""Behaviours, and agents that explore them."""


class Anything(NodesWorld):
    """Any number of behaviours, none of which is rewarded."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.task.reward = 0.0
        self.count = n

    @property
    def n(self) -> int:
        return self.count


def explore(n: int, agents: int, steps: int, seed: int) -> dict[str, np.ndarray]:
    """Events of agents that explore."""
    numbers = torch.arange(agents)
    agent, world = DNSarsa(n).spread(agents), Anything(n)
    memory = Events(agent, tuple(range(agents)), keep_weights=False)
    state = world.initial((agents,), seed, numbers)
    noise = Exploration(n, seed, numbers)
    Engine(agent, world, noise, memory, state, pays(steps)).advance(0, steps, True)
    return memory.joined()


def describe(n: int, agents: int, steps: int, events: dict[str, np.ndarray]) -> dict[str, float]:
    who, _, what = events["onset"].T
    each = np.bincount(who, minlength=agents)
    first = what[np.r_[True, who[1:] != who[:-1]]]
    same = (who[2:] == who[1:-1]) & (who[1:-1] == who[:-2])
    triples = np.zeros((n, n, n))
    np.add.at(triples, (what[:-2][same], what[1:-1][same], what[2:][same]), 1)
    a, b, c = np.indices(triples.shape)
    possible, total = (a != b) & (b != c), triples.sum()
    expected = np.broadcast_to(triples.sum(-1, keepdims=True) / (n - 1), triples.shape)[possible]
    square = ((triples[possible] - expected) ** 2 / np.maximum(expected, 1e-9)).sum()
    share = triples[possible] / total * possible.sum()
    return {
        "n": n, "agents": agents, "transitions": int(total),
        "behaviors": each.mean() * 50_000 / steps, "fewest": each.min() * 50_000 / steps,
        "returns": triples[(a == c) & possible].sum() / total, "chance": 1 / (n - 1),
        "rarest": share.min(), "commonest": share.max(), "chi_square": square,
        "p": float(chi2.sf(square, max(n * (n - 1) * (n - 2), 1))),
        "two_intentions": events["trouble"][0].sum() / steps / agents,
        "first": len(set(first)), "commonest_first": np.bincount(first).max() / agents,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/exploration"))
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), choices=SIZES)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    settle()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for n in arguments.sizes:
        events = explore(n, SIZES[n], arguments.steps, arguments.seed)
        rows.append(row := describe(n, SIZES[n], arguments.steps, events))
        print(
            f"{n:2d} behaviours: {row['behaviors']:.0f} in 50,000 steps (fewest "
            f"{row['fewest']:.0f}); returns {row['returns']:.4f} of {row['chance']:.4f}; two "
            f"intentions {row['two_intentions']:.1e}; first: {row['first']} of {n}",
            flush=True,
        )
        if n == 4:
            print(
                f"   {row['transitions']} transitions, triples {row['rarest']:.3f} to "
                f"{row['commonest']:.3f} of their share, chi-square {row['chi_square']:.1f}, "
                f"p = {row['p']:.2g}",
                flush=True,
            )
    about = {"commit": commit(), "seed": arguments.seed, "steps": arguments.steps}
    write_json(arguments.out / "results.json", about | {"rows": rows})


if __name__ == "__main__":
    main()

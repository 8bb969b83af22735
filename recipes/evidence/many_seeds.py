"""How often the sequence is found, and what becomes of those that found it.

Runs seeds 0, 1, 2, … of the default run (camera, PyBullet, 50,000 steps of exploration and
50,000 of exploitation) until twelve of them found the sequence while they explored, and
prints a line a seed and the sums. A run that has not found it by then ends there: it has
nothing to exploit. 2 to 5 minutes a seed and core. Results: section IV.C of
Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous Reinforcement of Behavioral
Sequences in Neural Dynamics": "In all trials in which the robot uncovered the rewarding
sequence in exploration mode, it was able to eventually execute the optimal policy".

    python recipes/evidence/many_seeds.py --found 12 --processes 2 --out runs/many_seeds
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from multiprocessing import get_context
from pathlib import Path

from dntorch.files import write_atomically
from dntorch.process import settle
from dntorch.runs.config import Config
from dntorch.runs.run import Trial
from dntorch.runs.train import results, train

SHOWN = ("behaviors_in_exploration", "found_in_exploration", "optimal_at_end", "disagreements",
         "longest_intention_overlap", "longest_cos_overlap", "steps_without_state")  # fmt: skip


def run_seed(seed: int, folder: Path, options: dict) -> dict:
    """One run from its start, or from where an earlier call stopped, to its end."""
    settle()
    folder.mkdir(parents=True, exist_ok=True)
    done, begun = folder / "results.json", folder / "checkpoint.pt"
    config = Config(seed=seed, **options)
    trial = Trial.load(begun) if begun.exists() else Trial(config)
    if trial.config != config:
        raise ValueError(f"{folder} holds a run with other options: name another --out")
    if done.exists():
        return json.loads(done.read_text())
    before = trial.step
    seconds = train(trial, begun, until=trial.config.explore)
    if len(trial.record.rewards):
        seconds += train(trial, begun)
    content = results(trial, trial.step - before, seconds)
    write_atomically(done, lambda file: file.write(json.dumps(content).encode()))
    return content


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--found", type=int, default=12, help="stop when so many found it")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/many_seeds"))
    parser.add_argument("--steps", type=int, default=Config.steps)
    parser.add_argument("--explore", type=int, default=Config.explore)
    parser.add_argument("--most", type=int, default=100, help="give up after so many seeds")
    arguments = parser.parse_args()
    options = {"steps": arguments.steps, "explore": arguments.explore}

    table: list[dict] = []
    with ProcessPoolExecutor(arguments.processes, get_context("spawn")) as pool:
        running, seeds = [], count()
        while sum(r["found_in_exploration"] for r in table) < arguments.found:
            while len(running) < arguments.processes and len(table) + len(running) < arguments.most:
                seed = next(seeds)
                folder = arguments.out / f"seed{seed}"
                running.append(pool.submit(run_seed, seed, folder, options))
            if not running:
                break
            table.append(running.pop(0).result())  # in the order of seeds
            line = table[-1]
            print(f"seed {line['seed']}: " + ", ".join(f"{k} {line[k]}" for k in SHOWN), flush=True)
        for future in running:
            future.cancel()

    found = [r for r in table if r["found_in_exploration"]]
    print(f"{len(table)} seeds, {len(found)} found it while exploring, of which "
          f"{sum(r['optimal_at_end'] for r in found)} are optimal at the end")  # fmt: skip
    write_atomically(
        arguments.out / "table.json",
        lambda file: file.write(json.dumps(table, indent=1).encode()),
    )


if __name__ == "__main__":
    main()

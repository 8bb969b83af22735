"""Does the length of an integrator step matter? 1, 2 and 4 sub-steps in a control step.

200 runs each of 100,000 control steps in the abstract world, the same chance for the same run:
how many found the sequence while they explored, how many of those are optimal at the end, with
Wilson intervals. About 5 minutes on two cores, resumable. Euler's method as in Kazerounian,
Luciw, Richter and Sandamirskaya, "Autonomous Reinforcement of Behavioral Sequences in Neural
Dynamics".

    python recipes/evidence/substeps.py --runs 200 --out runs/substeps
"""

import argparse
from pathlib import Path

from tqdm import tqdm

from dntorch.paper.points import entry
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job, run_groups


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--steps", type=int, default=Config.steps)
    parser.add_argument("--explore", type=int, default=Config.explore)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/substeps"))
    a = parser.parse_args()

    configs = {
        k: Config(world="nodes", steps=a.steps, explore=a.explore, substeps=k) for k in (1, 2, 4)
    }
    jobs = [
        Job(f"substeps{k}", Group(config, tuple(range(a.runs)), keep_weights=False))
        for k, config in configs.items()
    ]
    with tqdm(total=len(jobs) * a.steps, unit="step", unit_scale=True) as bar:
        events = run_groups(jobs, a.out, a.processes, lambda n: bar.update(n - bar.n), batches=1)
    for k, config in configs.items():
        (e,) = entry(events[f"substeps{k}"], config, a.runs)
        (optimal, found), (low, high) = e["optimal_given_found"], e["optimal_given_found_interval"]
        print(f"{k} sub-steps: found {found} of {a.runs}, optimal given found {optimal} of {found} "
              f"[{low:.3f}, {high:.3f}], behaviours in exploration "
              f"{e['behaviors_in_exploration']:.1f}")  # fmt: skip


if __name__ == "__main__":
    main()

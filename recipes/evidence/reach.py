"""How far it reaches: more colours, other and longer sequences, several rewarded ones.

Whether a sequence is *found* depends on random exploration alone (with n colours and L
items a hit has chance 1 / (n (n-1)^(L-1)) a behaviour), so exploration is led through the
sequence at two random times; it is random otherwise. What is measured is learning: of the
agents that completed the sequence while they explored, how many execute it in the end, and
after how many behaviours; beside it discrete SARSA(lambda) that learns from the very same
exploration and then follows its own values. 200 runs a point; prints a line a point and
draws one figure. Four minutes on two idle cores, resumable.

    python recipes/evidence/reach.py --runs 200 --out runs/reach
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from dntorch.colors import HUES
from dntorch.files import write_json
from dntorch.paper import discrete
from dntorch.paper.comparison import reference, theory_of, yoked_optimal
from dntorch.paper.populations import Population
from dntorch.paper.runs import runs_from_events
from dntorch.paper.statistics import wilson
from dntorch.paper.success import describe, needed_rewards, neural_success, success
from dntorch.process import commit
from dntorch.runs.config import Config
from dntorch.runs.jobs import Job, run_groups

#: Repertoire and rewarded sequences; the first column names the row of the figure.
POINTS = [
    ("colours", "RGB", ("GBRG",)),
    ("colours", "RGBY", ("GBYRG",)),
    ("colours", "RGBYM", ("GBYRG",)),
    ("colours", "RGBYMC", ("GBYRG",)),
    ("colours", "RGBYMCO", ("GBYRG",)),
    ("colours", "RGBYMCOV", ("GBYRG",)),
    ("length", "RGBYMC", ("GBG",)),
    ("length", "RGBYMC", ("GBYG",)),
    ("length", "RGBYMC", ("GBYRMG",)),
    ("length", "RGBYMC", ("GBYRMCG",)),
    ("others", "RGBY", ("GBYR",)),
    ("others", "RGBY", ("GBGYG",)),
    ("others", "RGBY", ("GBGRY",)),
    ("others", "RGBYMC", ("GBG", "YRY")),
    ("others", "RGBYMC", ("GBYG", "RMCR")),
]


def free(config: Config, explored: np.ndarray, total: np.ndarray, learning: discrete.Learning):
    """The discrete learner that explores on its own, uniformly, and exploits."""
    history = discrete.explore_or_exploit(
        learning, explored, total, config.seed, config.sequence, config.colors
    )
    needed = needed_rewards(config)
    return describe(success(history.rewarded, history.policy, explored, total, needed))


def draw(rows: list[dict]) -> Figure:
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    ax = figure.subplots()
    for shift, key, label, color in ((-0.2, "optimal_given_found", "neural", "#2f6fde"),
                                     (0.2, "yoked_optimal", "discrete, same exploration",
                                      "#b4bcc6")):  # fmt: skip
        for x, row in enumerate(rows):
            k, n = row[key]
            low, high = wilson(k, n)
            share = k / max(n, 1)
            ax.bar(x + shift, share, 0.38, color=color, label=label if x == 0 else None)
            ax.plot([x + shift] * 2, [low, high], color="#30363d", lw=1)
    names = [f"{' '.join(row['sequences'])}\n{len(row['colors'])} colours" for row in rows]
    ax.set_xticks(range(len(rows)), names, fontsize=8, rotation=45, ha="right")
    ax.set_ylabel("optimal at the end, given found")
    ax.legend(frameon=False, fontsize=9, loc="lower left")
    ax.set_ylim(0, 1.05)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=Config.steps)
    parser.add_argument("--explore", type=int, default=Config.explore)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--points", type=int, nargs="*", help="numbers of points, default all")
    parser.add_argument("--out", type=Path, default=Path("runs/reach"))
    a = parser.parse_args()
    base = Config(world="nodes", seed=a.seed, steps=a.steps, explore=a.explore)
    assert all(letter in HUES for _, colors, _ in POINTS for letter in colors)
    chosen = [POINTS[k] for k in a.points] if a.points else POINTS
    jobs = []
    for kind, colors, sequences in chosen:
        config = replace(base, colors=colors, sequence=sequences[0])
        group = Population(config, tuple(range(a.runs)), tasks=sequences[1:], shown=2)
        jobs.append(Job(f"{kind}-{colors}-{'-'.join(sequences)}", group))
    with tqdm(total=len(jobs) * base.steps, unit="step", unit_scale=True) as bar:
        folder = a.out / "parts"
        events = run_groups(
            jobs, folder, a.processes, lambda done: bar.update(done - bar.n), batches=1
        )

    learning = reference(theory_of(base))
    rows = []
    for (kind, colors, sequences), job in zip(chosen, jobs):
        config = job.group.config
        runs = runs_from_events(events[job.name], a.runs)
        result, explored, total = neural_success(runs, config)
        if len(sequences) > 1:  # any of them is optimal; their values tell of one only
            result = result._replace(needed=np.full(a.runs, -1))
        row = {"kind": kind, "colors": colors, "sequences": sequences} | describe(result)
        row["yoked_optimal"] = yoked_optimal(runs, explored, config, sequences, learning)
        row["discrete_uniform"] = free(config, explored, total, learning)
        row["chance_a_behavior"] = 1 / (len(colors) * (len(colors) - 1) ** (len(sequences[0]) - 1))
        rows.append(row)
        k, n = row["optimal_given_found"]
        y, m = row["yoked_optimal"]
        name = f"{colors:9} {' '.join(sequences):10}"
        print(f"{name} found {n:4}  optimal {k:4} ({k / max(n, 1):.2f})"
              f"  discrete, same exploration {y / max(m, 1):.2f}  behaviours to optimal "
              f"{row['behaviors_to_optimal']['median']}")  # fmt: skip
    content = {"runs": a.runs, "seed": a.seed, "commit": commit(), "points": rows}
    write_json(a.out / "reach.json", content)
    draw(rows).savefig(a.out / "reach.png", dpi=100, facecolor="white")


if __name__ == "__main__":
    main()

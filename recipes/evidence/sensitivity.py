"""How the result depends on each number that the paper does not give, and on dt.

One number at a time is changed, from far below its default to far above; 200 runs of
100,000 steps a point in the abstract world, all points in one batch. Prints a line a point
and draws one figure: P(optimal at the end | found) with its interval, shaded where the lower
bound is at least .90. Five minutes on two idle cores, resumable.

    python recipes/evidence/sensitivity.py --runs 200 --out runs/sensitivity
"""

import argparse
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from tqdm import tqdm

from dntorch.files import write_json
from dntorch.paper.points import Point, default, entry, job
from dntorch.process import commit
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job, run_groups

SWEEPS = {
    "learning rate (1/s)": (
        "learner.values.learning_rate", [0.005, 0.01, 0.02, 0.03, 0.1, 0.2, 0.4, 1.0]),
    "τ of the trace (s)": ("learner.trace.tau", [0.2, 0.35, 0.5, 0.7, 1.5, 2.0, 3.0, 5.0]),
    "τ of the value cell (s)": (
        "learner.opposition.tau_error", [0.04, 0.06, 0.2, 0.4, 0.8, 1.6]),
    "reward size": ("reward", [0.05, 0.2, 0.5, 1.0, 4.0, 8.0]),
    "reward length (s)": ("reward_duration", [0.0625, 0.25, 0.5, 2.0, 4.0]),
    "exploration noise": ("noise", [0.1, 0.3, 1.0, 3.0, 30.0, 100.0]),
    "pulse threshold": (
        "learner.opposition.pulse_threshold", [0.005, 0.01, 0.02, 0.1, 0.2, 0.3]),
}  # fmt: skip
TIME_STEPS = {"1/32 s Heun": (1, "heun"), "1/64 s": (2, "euler"), "1/128 s": (4, "euler")}


def draw(table: dict) -> Figure:
    figure = Figure(figsize=(13, 6.4), layout="constrained")
    axes = figure.subplots(2, 4).flat
    for ax, (title, rows) in zip(axes, table.items()):
        dt = title == "dt"
        x = list(range(len(rows))) if dt else [row["value"] for row in rows]
        ax.fill_between(x, *zip(*(r["found_interval"] for r in rows)), color="#b4bcc6", alpha=0.4,
                        lw=0, label="found")  # fmt: skip
        low, high = zip(*(r["optimal_given_found_interval"] for r in rows))
        share = [r["optimal_given_found"][0] / max(r["optimal_given_found"][1], 1) for r in rows]
        below = [max(s - bound, 0) for s, bound in zip(share, low)]
        above = [max(bound - s, 0) for s, bound in zip(share, high)]
        ax.errorbar(x, share, [below, above], fmt="o-", ms=4, lw=1.2, color="#2f6fde",
                    label="optimal, given found")  # fmt: skip
        for left, right, a, b in zip(x, x[1:], low, low[1:]):
            if a >= 0.9 and b >= 0.9:
                ax.axvspan(left, right, color="#30a46c", alpha=0.12, lw=0)
        if dt:
            ax.set_xticks(x, [row["value"] for row in rows], fontsize=8)
        else:
            ax.set_xscale("log")
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.axvline(next(r["value"] for r in rows if r["default"]), color="#e5484d", ls=":")
        ax.set_ylim(-0.03, 1.05)
        ax.set_title(title, loc="left", fontsize=11)
        ax.spines[["top", "right"]].set_visible(False)
    axes = figure.axes
    axes[0].legend(frameon=False, fontsize=8, loc="lower left")
    figure.suptitle("Shaded: lower bound of P(optimal | found) at least .90. Dotted: default.",
                    fontsize=10, x=0.01, ha="left")  # fmt: skip
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=Config.steps)
    parser.add_argument("--explore", type=int, default=Config.explore)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--no-dt", action="store_true", help="leave the time steps out")
    parser.add_argument("--out", type=Path, default=Path("runs/sensitivity"))
    a = parser.parse_args()
    config = Config(world="nodes", seed=a.seed, steps=a.steps, explore=a.explore)
    points, keys = [Point("default", {})], []
    for title, (path, values) in SWEEPS.items():
        usual = default(config, path)
        keys += [(title, value, False) for value in values] + [(title, usual, True)]
        points += [Point(f"{title} {value}", {path: value}) for value in values]
    jobs = [job("points", config, points, a.runs)]
    for name, (substeps, integrator) in {} if a.no_dt else TIME_STEPS.items():
        fine = replace(config, substeps=substeps, integrator=integrator)
        group = Group(fine, tuple(range(a.runs)), keep_weights=False)
        jobs.append(Job(name.replace("/", "_").replace(" ", "_"), group))
    a.out.mkdir(parents=True, exist_ok=True)
    with tqdm(total=a.processes * len(jobs) * config.steps, unit="step", unit_scale=True) as bar:
        events = run_groups(jobs, a.out / "parts", a.processes, lambda n: bar.update(n - bar.n))

    results = iter(entry(events["points"], config, a.runs))
    usual = next(results)
    table: dict[str, list] = {}
    for title, value, is_default in keys:
        row = usual if is_default else next(results)
        table.setdefault(title, []).append({"value": value, "default": is_default} | row)
    for rows in table.values():
        rows.sort(key=lambda row: row["value"])
    if not a.no_dt:
        table["dt"] = [{"value": "1/32 s", "default": True} | usual]
        for job_, name in zip(jobs[1:], TIME_STEPS):
            row = entry(events[job_.name], config, a.runs)[0]
            table["dt"].append({"value": name, "default": False} | row)
    for title, rows in table.items():
        for row in rows:
            k, n = row["optimal_given_found"]
            mark = " (default)" if row["default"] else ""
            print(f"{title:24} {row['value']!s:12} found {n:4}  optimal given found {k:4}  "
                  f"lower bound {row['optimal_given_found_interval'][0]:.3f}{mark}")  # fmt: skip
    content = {"runs": a.runs, "seed": a.seed, "commit": commit(), "sweeps": table}
    write_json(a.out / "sensitivity.json", content)
    draw(table).savefig(a.out / "sensitivity.png", dpi=100, facecolor="white")


if __name__ == "__main__":
    main()

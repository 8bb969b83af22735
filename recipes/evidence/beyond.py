"""The agent beyond the paper: what each of its parts does, beside what it is without.

Each section runs its lines as batches in the abstract world and prints a row a line, with the
number of runs and an interval; ``predictions.json`` says what was expected. Sections:

search       behaviours to the first reward, for sequences drawn from all: chance, and habituation
             to behaviours in contexts of 0 to 4 completions
lamp         the same for 6 colours where a lamp shows each right item: curiosity
autonomous   no phases, small noise: optimal at the end, rewards; edges of noise and learning rate
recall       sequences that the last completion cannot tell
change       another sequence is rewarded from the middle on
missing      a colour is nowhere
constraints  each behaviour is possible after two others only

Beside the agents, where it says so, discrete SARSA(lambda) that chooses by the same rule. An hour
on two idle cores for all, resumable.

    python recipes/evidence/beyond.py search lamp --runs 100 --out runs/beyond
    python recipes/evidence/beyond.py recall --world ring --lines "GBGYG, recall 1" --runs 60
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from dntorch.colors import indices
from dntorch.envs.task import SequenceTask
from dntorch.files import write_json
from dntorch.paper.autonomous import Rule, autonomous
from dntorch.paper.comparison import reference, theory_of
from dntorch.paper.drawn import draw_targets
from dntorch.paper.populations import Population
from dntorch.paper.predictions import predictions
from dntorch.paper.runs import Runs, runs_from_events
from dntorch.paper.statistics import wilson
from dntorch.process import commit
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.jobs import Job, run_groups
from dntorch.runs.record import LOOK_BACK, enough

COLORS = "ROYGCBVM"
Row = dict[str, Any]
Lines = dict[str, Population]


def alone(config: Config, runs: int, **others: Any) -> Population:
    return Population(config, tuple(range(runs)), keep_weights=False, **others)


def autonomous_config(seed: int, steps: int, **others: Any) -> Config:
    return Config(world="nodes", seed=seed, steps=steps, explore=steps, **AUTONOMOUS | others)


# ------------------------------------------------------------------ lines of each section


def search(seed: int, runs: int) -> Lines:
    usual = Config(world="nodes", seed=seed, steps=100_000, explore=100_000)
    orders = {f"order {k}": replace(usual, habituation=k) for k in range(5)}
    return {
        name: alone(config, 3 * runs, drawn=True)
        for name, config in ({"chance": usual} | orders).items()
    }


def lamp(seed: int, runs: int) -> Lines:
    six = {"colors": COLORS[:6], "sequence": "ROYGR"}
    return {"lamp": alone(autonomous_config(seed, 40_000, curiosity=4.0, **six), runs, drawn=True)}


def without_phases(seed: int, runs: int) -> Lines:
    lines = {}
    for sequence in ("GBYRG", "GBYR"):
        phases = Config(world="nodes", seed=seed, sequence=sequence)
        lines[f"{sequence}, two phases"] = alone(phases, runs)
        for noise in (0.02, 0.05, 0.1, 0.2):
            config = autonomous_config(seed, 100_000, sequence=sequence, noise=noise)
            lines[f"{sequence}, noise {noise}"] = alone(config, runs)
    for rate in (0.06, 0.1, 0.4):
        config = autonomous_config(seed, 100_000, learning_rate=rate)
        lines[f"GBYRG, learning rate {rate}"] = alone(config, runs)
    return lines


def recall(seed: int, runs: int) -> Lines:
    lines = {}
    for sequence, steps in {"GBGYG": 160_000, "GBGRY": 160_000, "GBYRG": 100_000}.items():
        for depth in (0, 1):
            config = autonomous_config(seed, steps, sequence=sequence, recall=depth)
            lines[f"{sequence}, recall {depth}"] = alone(config, runs)
    return lines


def change(seed: int, runs: int) -> Lines:
    later = {"then": "RBGYR", "change": 80_000}
    whole = autonomous_config(seed, 160_000, **later)
    phases = Config(world="nodes", seed=seed, steps=160_000, explore=50_000, **later)
    return {
        "autonomous": alone(whole, runs),
        "without habituation": alone(replace(whole, habituation=-1), runs),
        "two phases": alone(phases, runs),
    }


def missing(seed: int, runs: int) -> Lines:
    whole = autonomous_config(seed, 50_000, missing="B", sequence="GYRG")
    return {
        "patience 20 s": alone(whole, runs),
        "no patience": alone(replace(whole, patience=0.0), runs),
    }


def constraints(seed: int, runs: int) -> Lines:
    lines = {}
    for n in (8, 16):
        # A context of habituation would need 8 ** 5 cells, and the graph leaves two choices.
        config = autonomous_config(seed, 250_000, habituation=-1, patience=10.0)
        for name, rate in (("", 0.0), (", learned constraints", 20.0)):
            line = replace(config, constraints=rate)
            lines[f"{n} behaviours{name}"] = alone(line, runs, drawn=True, after=2, count=n)
    return lines


SECTIONS: dict[str, Callable[[int, int], Lines]] = {
    "search": search, "lamp": lamp, "autonomous": without_phases, "recall": recall,
    "change": change, "missing": missing, "constraints": constraints,
}  # fmt: skip


# ------------------------------------------------------------------ what a line says


def describe(group: Population, events: dict[str, np.ndarray]) -> Row:
    config, count = group.config, group.batch[0]
    runs = runs_from_events(events, count)
    total = (runs.steps >= 0).sum(1)
    row: Row = {"runs": count, "behaviors": float(total.mean())}
    row |= first_reward(runs, total, config)
    if not group.drawn:  # else each has a period of its own
        optimal = optimal_at(runs, total, config)
        row["optimal"] = [int(optimal.sum()), count]
        row["optimal_interval"] = list(wilson(int(optimal.sum()), count))
    row["rewards"] = float(runs.rewarded.sum(1).mean())
    row["failures"] = float(events["failures_end"].mean())
    row["two_intentions"] = float(runs.trouble[0].sum() / count / config.steps)
    row["disagreements"] = int(runs.disagreements.sum())
    # Of a run that hangs the last behaviour is long past.
    last = np.where(total > 0, runs.steps.max(1), 0)
    row["stuck"] = int((last < config.steps - 120 / config.dt).sum())
    if config.change:
        row |= after_change(runs, total, config)
    return row


def first_reward(runs: Runs, total: np.ndarray, config: Config) -> Row:
    """Behaviours to the first reward; a run without one counts as all its behaviours."""
    found = runs.rewarded.any(1)
    needed = np.where(found, runs.rewarded.argmax(1) + 1, total)
    at = np.where(found, runs.steps[np.arange(len(total)), needed - 1], config.steps)
    within = int((found & (needed <= 300)).sum())
    half = 1.96 * needed.std(ddof=1) / np.sqrt(len(needed)) if len(needed) > 1 else np.inf
    return {
        "first": np.where(found, needed, -1).tolist(),
        "found": [int(found.sum()), len(found)],
        "to_first": float(needed.mean()),
        "to_first_interval": [float(needed.mean() - half), float(needed.mean() + half)],
        "within_300": [within, len(found)],
        "within_300_interval": list(wilson(within, len(found))),
        "minutes_to_first": float(at.mean() * config.dt / 60),
    }


def optimal_at(runs: Runs, total: np.ndarray, config: Config) -> np.ndarray:
    """Whether the last 40 behaviours of each run brought enough rewards."""
    column = np.arange(runs.rewarded.shape[1])
    last = (column >= total[:, None] - LOOK_BACK) & (column < total[:, None])
    period = SequenceTask(config.then or config.sequence, config.colors).period
    return ((runs.rewarded & last).sum(1) >= enough(period)) & (total >= LOOK_BACK)


def after_change(runs: Runs, total: np.ndarray, config: Config) -> Row:
    """Behaviours from the change to the first 40 that brought enough rewards, these included.

    The median counts runs that never came to it as longer than all others.
    """
    begun = ((runs.steps >= 0) & (runs.steps < config.change)).sum(1)
    period = SequenceTask(config.then, config.colors).period
    needed = []
    for rewarded, first, end in zip(runs.rewarded, begun, total):
        sums = np.cumsum(np.append(0, rewarded[first:end]))
        good = np.flatnonzero(sums[LOOK_BACK:] - sums[:-LOOK_BACK] >= enough(period))
        needed.append(int(good[0]) + LOOK_BACK if len(good) else np.inf)
    median = float(np.median(needed))
    came = int(np.isfinite(needed).sum())
    return {"relearned": came, "to_relearn": median if np.isfinite(median) else None}


# ------------------------------------------------------------------ the discrete learner


def discrete(group: Population, row: Row) -> Row:
    """SARSA(lambda) with the rates that theory gives the agent, by the rule of the agent."""
    config, runs = group.config, group.batch[0]
    theory = theory_of(replace(config, recall=0, then="", change=0))
    rule = Rule(config.noise, config.habituation, config.recovery, depth=config.recall)
    n, length = len(config.colors), len(config.sequence)
    targets = np.tile(indices(config.sequence, config.colors), (runs, 1))
    if group.drawn:
        targets = draw_targets(config.seed, group.agents, n, length).numpy()
    total, then = round(row["behaviors"]), None
    if config.then:
        later = np.tile(indices(config.then, config.colors), (runs, 1))
        then = later, round(total * config.change / config.steps)
    reward = theory.reward / theory.old
    behaviors, rewarded = autonomous(
        reference(theory), reward, rule, targets, n, total, config.seed, then
    )
    steps = np.tile((np.arange(total) + 1) * config.steps // total, (runs, 1))
    none = np.zeros(0, np.float32)
    twin = Runs(steps, behaviors, rewarded, none, none, np.zeros(runs, int), np.zeros((2, runs)))
    totals = np.full(runs, total)
    result = first_reward(twin, totals, config)
    if not group.drawn:
        result["optimal"] = [int(optimal_at(twin, totals, config).sum()), runs]
    return result | (after_change(twin, totals, config) if config.then else {})


# ------------------------------------------------------------------ what is shown


def told(row: Row) -> Row:
    """Without what is long."""
    kept = {k: v for k, v in row.items() if not k.endswith("interval") and k != "first"}
    return kept | ({"discrete": told(row["discrete"])} if "discrete" in row else {})


#: What the bars of a section are, and how it is called.
BARS = {
    "autonomous": ("optimal", "share optimal at the end"),
    "recall": ("optimal", "share optimal at the end"),
    "change": ("optimal", "share optimal with the second sequence"),
    "missing": ("behaviors", "behaviours completed"),
    "constraints": ("failures", "failures of a run"),
}


def draw(section: str, rows: dict[str, Row]) -> Figure:
    """How many found it after how many behaviours, or a bar a line."""
    figure = Figure((8, 0.8 + 0.42 * max(len(rows), 6)), layout="constrained")
    ax = figure.subplots()
    ax.spines[["top", "right"]].set_visible(False)
    if section in BARS:
        _bars(ax, rows, *BARS[section])
    else:
        _found(ax, section, rows)
    return figure


def _bars(ax: Axes, rows: dict[str, Row], key: str, label: str) -> None:
    for k, (name, row) in enumerate(rows.items()):
        value = row[key]
        share = value[0] / value[1] if isinstance(value, list) else value
        ax.barh(k, share, color="#2f6fde", alpha=0.8)
        if isinstance(value, list):
            low, high = row[f"{key}_interval"]
            ax.plot([low, high], [k, k], color="#30363d", lw=1.5)
        if "discrete" in row and isinstance(value, list):
            twin = row["discrete"][key]
            ax.plot(twin[0] / twin[1], k, "o", color="#e5484d", label="discrete SARSA(λ)")
        ax.text(0, k, f" {name}", va="center", color="white" if share else "#30363d", fontsize=9)
    ax.set(yticks=[], xlabel=label)
    ax.invert_yaxis()
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        ax.legend(handles[:1], labels[:1], frameon=False, fontsize=8, loc="lower right")


def _found(ax: Axes, section: str, rows: dict[str, Row]) -> None:
    for name, row in rows.items():
        first = np.sort([k for k in row["first"] if k > 0])
        share = np.arange(1, len(first) + 1) / len(row["first"])
        ax.step(first, share, where="post", label=name, lw=2 if name == "order 4" else 1.2)
    n, length = (6, 5) if section == "lamp" else (4, 5)
    count = n * (n - 1) ** (length - 1)
    last = max(max(row["first"]) for row in rows.values())
    x = np.arange(max(last, 2))
    chance = "chance in theory" if section == "lamp" else "no explorer can be better"
    limit = 1 - (1 - 1 / count) ** x if section == "lamp" else np.minimum(x / count, 1)
    ax.plot(x, limit, color="#30363d", ls="--", lw=1, label=chance)
    ax.set(xlabel="behaviours", ylabel="share that found the sequence", ylim=(0, 1.02))
    ax.legend(frameon=False, fontsize=8)


def shortened(group: Population, most: int | None) -> Population:
    """The same runs, of ``most`` control steps."""
    config = group.config
    if most is None or config.steps <= most:
        return group
    share = most / config.steps
    explore, change = round(share * config.explore), round(share * config.change)
    return replace(group, config=replace(config, steps=most, explore=explore, change=change))


def placed(group: Population, world: str) -> Population:
    """The same runs among blocks, seen by a camera; there each has a seed of its own."""
    if world == group.config.world:
        return group
    if group.drawn or group.after:
        raise SystemExit("drawn sequences and worlds are abstract: leave --world out")
    seeds = tuple(group.config.seed + k for k in group.agents)
    config = replace(group.config, world=world)
    return Population(config, seeds=seeds, rows=group.agents, keep_weights=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--world", choices=["nodes", "ring"], default="nodes")
    parser.add_argument("--lines", nargs="+", help="names of lines; by default all")
    parser.add_argument("--steps", type=int, help="control steps of a line at most")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/beyond"))
    a = parser.parse_args()
    if unknown := set(a.sections) - set(SECTIONS):
        parser.error(f"{', '.join(sorted(unknown))}: choose from {', '.join(SECTIONS)}")
    expected = predictions("beyond")
    for section in a.sections or SECTIONS:
        lines = SECTIONS[section](a.seed, a.runs)
        names = {name: f"{section}-{a.world}-{k}" for k, name in enumerate(lines)}
        if a.lines is not None and (unknown := set(a.lines) - set(lines)):
            parser.error(f"{unknown} in {section}: choose from {', '.join(lines)}")
        lines = {
            name: placed(shortened(group, a.steps), a.world)
            for name, group in lines.items()
            if a.lines is None or name in a.lines
        }
        jobs = [Job(names[name], group) for name, group in lines.items()]
        total = sum(group.config.steps for group in lines.values())
        with tqdm(total=total, unit="step", unit_scale=True, desc=section) as bar:
            events = run_groups(
                jobs, a.out / "parts", a.processes, lambda n: bar.update(n - bar.n), batches=1
            )
        rows = {name: describe(group, events[names[name]]) for name, group in lines.items()}
        for name, group in lines.items():
            if (
                section in ("search", "recall", "change")
                and group.config.explore == group.config.steps
            ):
                rows[name]["discrete"] = discrete(group, rows[name])
        for name, row in rows.items():
            print(f"{name:32}", told(row))
        content = {"runs": a.runs, "seed": a.seed, "commit": commit(), "lines": rows}
        name = section if a.world == "nodes" else f"{section}-{a.world}"
        write_json(a.out / f"{name}.json", content | {"predicted": expected[section]})
        draw(section, rows).savefig(a.out / f"beyond_{name}.png", dpi=100, facecolor="white")


if __name__ == "__main__":
    main()

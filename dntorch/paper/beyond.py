"""The agent beyond the paper: lines of runs, section by section, and what each comes to.

``dntorch beyond`` runs them; docs/beyond.md has the numbers.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dntorch.colors import indices
from dntorch.envs.task import SequenceTask
from dntorch.paper.autonomous import Rule, autonomous
from dntorch.paper.comparison import reference, theory_of
from dntorch.paper.drawn import draw_targets
from dntorch.paper.populations import Population
from dntorch.paper.runs import Runs, runs_from_events
from dntorch.paper.statistics import wilson
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.record import LOOK_BACK, enough

COLORS = "ROYGCBVM"
Row = dict[str, Any]
Lines = dict[str, Population]


SOON = ", recovery 600"
"""Of lines in which what was tried is fresh again twice as soon."""


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
        config = autonomous_config(seed, 100_000, sequence=sequence, recovery=600.0)
        lines[f"{sequence}, noise 0.2{SOON}"] = alone(config, runs)
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
        lines[f"{sequence}, recall 1{SOON}"] = alone(replace(config, recovery=600.0), runs)
    return lines


def change(seed: int, runs: int) -> Lines:
    later = {"then": "RBGYR", "change": 80_000}
    whole = autonomous_config(seed, 160_000, **later)
    phases = Config(world="nodes", seed=seed, steps=160_000, explore=50_000, **later)
    return {
        "autonomous": alone(whole, runs),
        f"autonomous{SOON}": alone(replace(whole, recovery=600.0), runs),
        "without habituation": alone(replace(whole, habituation=-1), runs),
        "two phases": alone(phases, runs),
    }


def missing(seed: int, runs: int) -> Lines:
    whole = autonomous_config(seed, 50_000, missing="B", sequence="GYRG")
    return {
        "patience 20 s": alone(whole, runs),
        "no patience": alone(replace(whole, patience=0.0, constraints=0.0), runs),
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
    last = np.where(total > 0, runs.steps.max(1, initial=0), 0)
    row["stuck"] = int((last < config.steps - 120 / config.dt).sum())
    if config.change:
        row |= after_change(runs, total, config)
    return row


def first_reward(runs: Runs, total: np.ndarray, config: Config) -> Row:
    """Behaviours to the first reward; a run without one counts as all its behaviours."""
    found = runs.rewarded.any(1)
    rewarded, steps = (np.pad(x, ((0, 0), (0, 1))) for x in (runs.rewarded, runs.steps))
    needed = np.where(found, rewarded.argmax(1) + 1, total)
    at = np.where(found, steps[np.arange(len(total)), needed - 1], config.steps)
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
        raise ValueError(f"--world={world}: drawn sequences and worlds are abstract: leave it out")
    seeds = tuple(group.config.seed + k for k in group.agents)
    config = replace(group.config, world=world)
    return Population(config, seeds=seeds, rows=group.agents, keep_weights=False)

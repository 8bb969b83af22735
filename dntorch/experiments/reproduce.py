"""The paper's claims over many runs: run, measure, judge, write down."""

import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

import dntorch
from dntorch.experiments import discrete
from dntorch.experiments import statistics as st
from dntorch.experiments.batches import Job, run_all, run_groups, total_steps
from dntorch.experiments.checkpoint import write_atomically
from dntorch.experiments.config import Config, build_agent
from dntorch.experiments.epuck_runs import camera_runs, run_camera
from dntorch.experiments.measures import (
    Outcome,
    Runs,
    correlation,
    describe,
    measured_decay,
    neural_outcome,
    outcome,
    runs_from_events,
    transition_counts,
    transitions,
    update_regression,
)
from dntorch.experiments.population import Group
from dntorch.experiments.record import Record
from dntorch.experiments.trial import Trial

PREDICTIONS = Path(__file__).parents[2] / "docs" / "predictions.json"
BINS = 100
"""Points of a curve over time."""


class Study(NamedTuple):
    """What the figures and the page are made of."""

    config: Config
    runs: Runs
    outcome: Outcome
    explored: np.ndarray
    total: np.ndarray
    results: dict[str, Any]


def reproduce(
    config: Config,
    runs: int,
    folder: Path,
    processes: int = 2,
    progress: Callable[[int], Any] = lambda steps: None,
) -> Study:
    """All runs, and ``results.json``. What a folder holds already is not run again."""
    began = time.monotonic()
    parts = folder / "parts"
    if config.world == "nodes":
        events = run_groups(groups(config, runs), parts, processes, progress)
        neural, single = (runs_from_events(events[name], runs) for name in ("neural", "single"))
    else:
        seeds = [replace(config, seed=config.seed + k) for k in range(runs)]
        run_all(run_camera, seeds, parts, processes, progress)
        neural, single = camera_runs(seeds, parts), None
    study = measure(config, neural, single)
    study.results["runs"], study.results["duration_seconds"] = runs, time.monotonic() - began
    text = json.dumps(plain(study.results), indent=1) + "\n"
    write_atomically(folder / "results.json", lambda file: file.write(text.encode()))
    return study


def groups(config: Config, runs: int) -> list[Job]:
    """The agents of the paper, and those with a trace of one item."""
    agents = tuple(range(runs))
    return [
        Job("neural", Group(config, agents)),
        Job("single", Group(config, agents, "single_item")),
    ]


def steps_to_take(config: Config, runs: int, processes: int) -> int:
    """The sum that the progress of `reproduce` reaches."""
    if config.world == "nodes":
        return total_steps(groups(config, runs), processes)
    return runs * config.steps


# ---------------------------------------------------------------------- measure


def measure(config: Config, runs: Runs, single: Runs | None) -> Study:
    """Everything that is said about the runs."""
    result, explored, total = neural_outcome(runs, config)
    n = len(config.colors)
    counts = transition_counts(runs, config.explore, n)
    expected = theory_of(config)
    learning = discrete.Learning(expected.old, min(expected.trace_decay, 1.0))
    budget = (explored, total, config.seed, config.sequence, config.colors)
    learners = {
        "sarsa": (learning, None),
        "sarsa_replacing": (replace(learning, replacing=True), None),
        "td0": (replace(learning, trace_decay=0.0), None),
        "sarsa_matched": (learning, counts),
        "sarsa_replacing_matched": (replace(learning, replacing=True), counts),
        "td0_matched": (replace(learning, trace_decay=0.0), counts),
    }
    outcomes = {"neural": result}
    for name, (kind, chances) in learners.items():
        history = discrete.explore_or_exploit(kind, *budget, chances=chances)
        outcomes[name] = outcome(history.rewarded, history.policy, explored, total)
    if single is not None:
        outcomes["neural_single_item"] = neural_outcome(single, config)[0]
    results: dict[str, Any] = {
        "version": dntorch.__version__,
        "commit": commit(),
        "world": config.world,
        "seed": config.seed,
        "dt": config.dt,
        "config": asdict(config),
        "behaviors_in_exploration": [float(explored.mean()), float(explored.std(ddof=1))]
        if len(explored) > 1
        else [float(explored.mean()), 0.0],
    }
    results |= {name: describe(each) for name, each in outcomes.items()}
    if single is None:
        nobody = np.zeros(0, np.int64)
        results["neural_single_item"] = describe(Outcome(*[nobody > 0] * 3, nobody, nobody))
    results |= {
        "equivalence": equivalence(outcomes),
        "theory": expected._asdict(),
        "update_regression": learning_law(runs, result, config),
        "transition_counts": counts,
        "exploration": exploration(counts, config),
        "errors_of_the_world": {
            "disagreements": int(runs.disagreements.sum()),
            "steps_with_two_intentions": int(runs.trouble[0].sum()),
            "steps_without_state": int(runs.trouble[1].sum()),
        },
        "td_error": td_error(config, runs, result, explored, total),
        "shortcuts": shortcuts(config, runs, result, explored),
    }
    results |= compare(config, runs, result, explored, learning)
    return Study(config, runs, result, explored, total, results)


def theory_of(config: Config) -> st.Theory:
    """Learning rates and lambda that the parameters of a config predict."""
    area = config.reward * config.reward_duration
    return st.theory(
        config.learning_rate, config.trace_tau, area, hand_over(config),
        reward_duration=config.reward_duration,
    )  # fmt: skip


def hand_over(config: Config, steps: int = 3000) -> float:
    """Seconds from the end of a pair to the begin of the next, in one short exploration."""
    trial = Trial(replace(config, world="nodes", steps=steps, explore=steps))
    trial.advance(steps)
    record = trial.record
    active = ((record.intention > 0.5).any(1)) & ((record.satisfaction > 0.5).any(1))
    same = (record.intention > 0.5) & (record.satisfaction > 0.5)
    active &= ~same.any(1)  # the pair (i, i) does not exist
    edges = np.flatnonzero(np.diff(active.astype(int)))
    gaps = np.diff(edges)[~active[edges[:-1] + 1]]
    return float(np.median(gaps)) * config.dt if len(gaps) else 0.5


def equivalence(outcomes: dict[str, Outcome]) -> dict[str, Any]:
    """Two one-sided tests of the neural against each discrete learner with traces."""
    margins = json.loads(PREDICTIONS.read_text())["main"]["equivalence"]
    neural = outcomes["neural"]
    table = {}
    for name in ("sarsa_matched", "sarsa_replacing_matched", "sarsa", "sarsa_replacing"):
        other = outcomes[name]
        k = [(int(o.optimal[o.found].sum()), int(o.found.sum())) for o in (neural, other)]
        late = [(int(o.late[o.found].sum()), int(o.found.sum())) for o in (neural, other)]
        needed = [o.needed[o.found & o.optimal & (o.needed > 0)] for o in (neural, other)]
        table[name] = {
            "optimal_given_found": st.equivalent_proportions(
                *k, margins["optimal_given_found_margin"]
            ),
            "optimal_only_in_exploitation": st.equivalent_proportions(
                *late, margins["optimal_only_in_exploitation_margin"]
            ),
            "behaviors_to_optimal": st.equivalent_means(
                *needed, margins["behaviors_to_optimal_margin"]
            ),
        }
    return table


def learning_law(runs: Runs, result: Outcome, config: Config) -> dict[str, Any]:
    """The regression of the weight change of old pairs, and the decay of their trace."""
    t = transitions(runs, result.found)
    entry = {}
    for name, select in (
        ("", None),
        ("exploration", t.step < config.explore),
        ("exploitation", t.step >= config.explore),
    ):
        fit = update_regression(t, select)
        named = dict(zip(("next", "old", "reward"), fit.coefficients))
        part = {f"{k}_coefficient": float(v) for k, v in named.items()}
        part |= {f"{k}_error": float(v) for k, v in zip(named, fit.errors)}
        part |= {"r2": fit.r2, "transitions": fit.count}
        entry |= {name: part} if name else part
    decay = measured_decay(t)
    return entry | {
        "decay": float(decay.coefficients[0]),
        "lambda": float(decay.coefficients[0] / 0.8),
        "decay_transitions": decay.count,
    }


def exploration(counts: np.ndarray, config: Config) -> dict[str, Any]:
    """Whether three successive behaviours are uniform, and what that does to finding."""
    n = counts.shape[0]
    i, j, k = np.indices(counts.shape)
    possible = (i != j) & (j != k)
    back = (i == k) & possible
    share = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    path = [config.colors.index(letter) for letter in config.sequence]
    chance = counts.sum((0, 2))[path[0]] / max(counts.sum(), 1)
    pairs = counts.sum(2)[path[0], path[1]] / max(counts.sum((1, 2))[path[0]], 1)
    chance *= pairs * np.prod([share[a, b, c] for a, b, c in zip(path, path[1:], path[2:])])
    return st.uniformity(counts[possible]) | {
        "return_share": float(counts[back].sum() / max(counts.sum(), 1)),
        "return_share_if_uniform": 1 / (n - 1),
        "chance_of_the_sequence": float(chance),
        "chance_if_uniform": 1 / (n * (n - 1) ** (len(path) - 1)),
    }


def compare(
    config: Config, runs: Runs, result: Outcome, explored: np.ndarray, learning: discrete.Learning
) -> dict[str, Any]:
    """The discrete learner fed with the transitions of the neural runs: correlations over time."""
    which = np.flatnonzero(result.found)
    if len(which) == 0:
        return {"yoked_correlation": None, "yoked": {}}
    behaviors = runs.behaviors[which]
    at = tuple(range(20, behaviors.shape[1] - 1, 20))
    # Values after the transition that ends with onset k + 1 are known at onset k + 1.
    _, kept = discrete.yoked(learning, behaviors, runs.rewarded[which], tuple(range(10**4)))
    curve = {}
    for k in at:
        going = behaviors[:, k] >= 0
        r = correlation(runs.weights[which, k][going], kept[k][going])
        r = r[np.isfinite(r)]
        if len(r) > len(which) / 2:
            curve[k] = float(r.mean())
    last = explored[which] - 1
    own = runs.weights[which, last]
    other = np.stack([kept[k][row] for row, k in enumerate(last)])
    r = correlation(own, other)
    r = r[np.isfinite(r)]
    early = (runs.rewarded & (np.arange(runs.rewarded.shape[1]) < explored[:, None])).sum(1)[which]
    return {
        "yoked_correlation": float(r.mean()) if len(r) else None,
        "yoked": {
            "interval_of_mean": st.mean_interval(r),
            "summary": st.summary(r),
            "lowest": float(r.min()) if len(r) else None,
            "over_behaviors": curve,
            "learning_rate": learning.rate,
            "lambda": learning.trace_decay,
            "finds_while_exploring": st.summary(early),
        },
    }


def td_error(
    config: Config, runs: Runs, result: Outcome, explored: np.ndarray, total: np.ndarray
) -> dict[str, Any]:
    """Mean size of the TD error per transition, over time; of runs that found the sequence.

    The integral of reward plus value cell over a transition, by the width of a pulse.
    """
    width = theory_width()
    area = config.reward * config.reward_duration
    v = runs.error[:, 1:, 0]
    delta = abs(v + area * runs.rewarded[:, :-1]) / width
    cell = runs.error[:, 1:, 1] / width
    step, found = runs.steps[:, 1:], result.found[:, None]
    edges = np.linspace(0, config.steps, BINS + 1)
    curves = {}
    for name, size in (("with_reward", delta), ("value_cell", cell)):
        chosen = (step >= 0) & found
        total_size, _ = np.histogram(step[chosen], edges, weights=size[chosen])
        number, _ = np.histogram(step[chosen], edges)
        curves[name] = total_size / np.maximum(number, 1)
    column = np.arange(delta.shape[1])
    last = (column >= total[:, None] - 41) & (column < total[:, None] - 1) & found & (step >= 0)
    paid = last & runs.rewarded[:, :-1]
    which = np.flatnonzero(result.found)
    first = delta[which, result.first[which].clip(max=delta.shape[1] - 1)]
    return {
        "at_first_find": float(first.mean()) if len(first) else None,
        "last_40": float(delta[last].mean()) if last.any() else None,
        "last_40_rewarded": float(delta[paid].mean()) if paid.any() else None,
        "bins": BINS,
        "curves": curves,
    }


def theory_width() -> float:
    begin, end, _ = st.pulse_above(0.05, 0.5)
    return end - begin


def shortcuts(config: Config, runs: Runs, result: Outcome, explored: np.ndarray) -> dict[str, Any]:
    """One run that became optimal only while it exploited: each wrong choice and its value."""
    late = np.flatnonzero(result.late & (result.needed > 0))
    if len(late) == 0:
        return {"run": None, "choices": []}
    run = late[np.argmax(result.needed[late] - explored[late])]
    path = [config.colors.index(letter) for letter in config.sequence]
    wanted = {(s, a) for s, a in zip(path, path[1:])}
    choices = []
    for k in range(explored[run], min(result.needed[run] + 4, (runs.steps[run] >= 0).sum() - 1)):
        s, a = runs.behaviors[run, k], runs.behaviors[run, k + 1]
        w = runs.weights[run, k]
        choices.append({
            "behavior": int(k), "state": config.colors[s], "action": config.colors[a],
            "shortcut": (int(s), int(a)) not in wanted, "value": float(w[s, a]),
            "rewarded": bool(runs.rewarded[run, k + 1]),
        })  # fmt: skip
    return {"run": int(run), "choices": choices}


# ---------------------------------------------------------------------- small things


def example(study: Study, run: int, steps: int = 1500) -> tuple[Record, Config]:
    """A piece of one run's exploration, and a piece with what it had learned in the end."""
    config = replace(study.config, world="nodes", steps=2 * steps, explore=steps)
    trial = Trial(config)
    trial.exploration.agents = trial.world.world.agents = torch.tensor(run)  # type: ignore
    trial.advance(steps)
    last = int(study.total[run]) - 1
    learned = torch.from_numpy(study.runs.weights[run, last].swapaxes(-1, -2).copy())
    trial.agent.weights.copy_(learned)
    trial.advance(steps)
    return trial.record, config


def commit() -> str | None:
    """The commit that the code is at, if it is in a git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def plain(value: Any) -> Any:
    """The same in what JSON knows: lists and numbers, null for nan and infinity."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def parameters_of(config: Config) -> int:
    """Numbers that the agent learns."""
    return build_agent(config).weights.numel()

"""Everything that is said about many runs of the agent, beside the discrete learners."""

from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

import dntorch
from dntorch.paper import statistics as st
from dntorch.paper.comparison import (
    discrete_success,
    equivalence,
    reference,
    theory_of,
    yoked,
)
from dntorch.paper.law import measured_decay, transition_counts, transitions, update_regression
from dntorch.paper.runs import Runs
from dntorch.paper.success import Success, describe, neural_success
from dntorch.process import commit
from dntorch.runs.config import Config
from dntorch.runs.record import LOOK_BACK

BINS = 100
"""Points of a curve over time."""


class Study(NamedTuple):
    """What the figures and the page are made of."""

    config: Config
    runs: Runs
    success: Success
    explored: np.ndarray
    total: np.ndarray
    results: dict[str, Any]


def measure(config: Config, runs: Runs, single: Runs | None) -> Study:
    """Everything that is said about the runs."""
    result, explored, total = neural_success(runs, config)
    counts = transition_counts(runs, config.explore, len(config.colors))
    expected = theory_of(config)
    learning = reference(expected)
    learners = discrete_success(config, learning, explored, total, counts)
    kinds = {"neural": result} | learners
    if single is not None:
        kinds["neural_single_item"] = neural_success(single, config)[0]
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
    results |= {name: describe(each) for name, each in kinds.items()}
    if single is None:
        nobody = np.zeros(0, np.int64)
        results["neural_single_item"] = describe(Success(*[nobody > 0] * 3, nobody, nobody))
    results |= {
        "equivalence": equivalence(result, learners),
        "theory": expected._asdict(),
        "update_regression": learning_law(runs, result, config, expected.discount),
        "transition_counts": counts,
        "exploration": exploration(runs, config),
        "errors_of_the_world": {
            "disagreements": int(runs.disagreements.sum()),
            "steps_with_two_intentions": int(runs.trouble[0].sum()),
            "steps_without_state": int(runs.trouble[1].sum()),
        },
        "td_error": td_error(config, runs, result, total, expected.width),
        "shortcuts": shortcuts(config, runs, result, explored),
    }
    results |= yoked(runs, result, explored, learning)
    return Study(config, runs, result, explored, total, results)


def learning_law(runs: Runs, result: Success, config: Config, discount: float) -> dict[str, Any]:
    """The regression of the weight change of old pairs, and the decay of their trace."""
    t = transitions(runs, result.found, discount)
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
        "lambda": float(decay.coefficients[0] / discount),
        "decay_transitions": decay.count,
    }


def exploration(runs: Runs, config: Config) -> dict[str, Any]:
    """Whether three successive behaviours are uniform, and what that does to finding.

    Up to the first find: learned values, small as they are beside the noise, bias later choices.
    """
    n = len(config.colors)
    counts = transition_counts(runs, config.explore, n, unrewarded=True)
    i, j, k = np.indices(counts.shape)
    possible = (i != j) & (j != k)
    back = (i == k) & possible
    share = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    path = [config.colors.index(letter) for letter in config.sequence]
    chance = counts.sum((0, 2))[path[0]] / max(counts.sum(), 1)
    pairs = counts.sum(2)[path[0], path[1]] / max(counts.sum((1, 2))[path[0]], 1)
    chance *= pairs * np.prod([share[a, b, c] for a, b, c in zip(path, path[1:], path[2:])])
    alike = counts[possible] / max(counts[possible].mean(), 1)
    return st.uniformity(counts[possible]) | {
        "transitions": int(counts.sum()),
        "rarest": float(alike.min()),
        "commonest": float(alike.max()),
        "return_share": float(counts[back].sum() / max(counts.sum(), 1)),
        "return_share_if_uniform": 1 / (n - 1),
        "chance_of_the_sequence": float(chance),
        "chance_if_uniform": 1 / (n * (n - 1) ** (len(path) - 1)),
    }


def td_error(
    config: Config, runs: Runs, result: Success, total: np.ndarray, width: float
) -> dict[str, Any]:
    """Mean size of the TD error per transition, over time; of runs that found the sequence.

    The integral of reward plus value cell over a transition, by the ``width`` of a pulse in s.
    """
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
    end = total[:, None] - 1
    last = (column >= end - LOOK_BACK) & (column < end) & found & (step >= 0)
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


def shortcuts(config: Config, runs: Runs, result: Success, explored: np.ndarray) -> dict[str, Any]:
    """Runs that became optimal only while they exploited, and one of them choice by choice.

    A shortcut is a choice off the rewarded sequence. It counts as unlearned when all that a
    run took since exploration were worth less when its values came to execute the sequence.
    """
    path = [config.colors.index(letter) for letter in config.sequence]
    wanted = set(zip(path, path[1:]))
    late = np.flatnonzero(result.late & (result.needed > 0))
    unlearned = 0
    for run in late:
        first, last = explored[run] - 1, result.needed[run] - 1
        c, w = runs.behaviors[run], runs.weights[run]
        taken = set(zip(c[first:last].tolist(), c[first + 1 : last + 1].tolist())) - wanted
        unlearned += bool(taken) and all(w[last][pair] < w[first][pair] for pair in taken)
    entry: dict[str, Any] = {"unlearned": [unlearned, len(late)], "run": None, "choices": []}
    if len(late) == 0:
        return entry
    run = late[np.argmax(result.needed[late] - explored[late])]
    for k in range(explored[run], min(result.needed[run] + 4, (runs.steps[run] >= 0).sum() - 1)):
        s, a = runs.behaviors[run, k : k + 2].tolist()
        entry["choices"].append({
            "behavior": int(k), "state": config.colors[s], "action": config.colors[a],
            "shortcut": (s, a) not in wanted, "value": float(runs.weights[run, k, s, a]),
            "rewarded": bool(runs.rewarded[run, k + 1]),
        })  # fmt: skip
    return entry | {"run": int(run)}

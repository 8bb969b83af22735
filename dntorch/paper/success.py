"""What became of runs: found, optimal, and when."""

from typing import Any, NamedTuple

import numpy as np

from dntorch.colors import indices
from dntorch.envs.task import SequenceTask
from dntorch.paper.discrete import executes
from dntorch.paper.runs import Runs
from dntorch.paper.statistics import summary, wilson
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.record import LOOK_BACK, enough


class Success(NamedTuple):
    """What became of each run, ``(runs,)`` each."""

    found: np.ndarray
    """completed the sequence while it explored"""
    optimal: np.ndarray
    """nine in ten of the possible rewards within its last 40 behaviours"""
    late: np.ndarray
    """optimal, but its values did not yet execute the sequence when exploration ended"""
    first: np.ndarray
    """behaviours until the first find, -1 if none while exploring"""
    needed: np.ndarray
    """behaviours until the values execute the sequence and do so to the end, -1 if never"""


def policies(weights: np.ndarray, config: Config) -> np.ndarray:
    """Whether the greedy choice by values ``[..., state, action]`` executes the sequence.

    Where nothing has been learned, the innate preference of the value nodes decides.
    """
    nodes = build_agent(config).value_nodes
    preference = (nodes.baseline * nodes.ladder).double().numpy()
    wanted = np.maximum(weights, 0) + preference
    choice = np.where(np.eye(len(preference), dtype=bool), -np.inf, wanted).argmax(-1)
    return executes(choice, np.array(indices(config.sequence, config.colors)))


def needed_rewards(config: Config) -> int:
    """Rewards within the last `LOOK_BACK` behaviours that make a run optimal."""
    return enough(SequenceTask(config.sequence, config.colors).period)


def success(
    rewarded: np.ndarray,
    policy: np.ndarray,
    explored: np.ndarray,
    total: np.ndarray,
    needed_rewards: int,
) -> Success:
    """Judge runs of ``total`` behaviours, the first ``explored`` of them random.

    ``policy`` (runs, T) says whether the values after each behaviour execute the sequence;
    ``needed_rewards`` within the last `LOOK_BACK` behaviours make a run optimal.
    """
    column = np.arange(rewarded.shape[1])
    exploring = column < explored[:, None]
    early = rewarded & exploring
    found = early.any(1)
    last = (column >= total[:, None] - LOOK_BACK) & (column < total[:, None])
    optimal = ((rewarded & last).sum(1) >= needed_rewards) & (total >= LOOK_BACK)
    if policy.size == 0:
        nothing = np.full(len(found), -1)
        return Success(found, optimal, found & False, np.where(found, early.argmax(1), -1), nothing)
    wrong = ~policy & (column < total[:, None])
    last_wrong = np.where(wrong.any(1), wrong.shape[1] - 1 - wrong[:, ::-1].argmax(1), -1)
    ever = last_wrong + 1 < total
    at_end = policy[np.arange(len(found)), (explored - 1).clip(min=0)]
    return Success(
        found,
        optimal,
        found & optimal & ~at_end,
        np.where(found, early.argmax(1), -1),
        np.where(ever, last_wrong + 2, -1),
    )


def neural_success(runs: Runs, config: Config) -> tuple[Success, np.ndarray, np.ndarray]:
    """Success, number of behaviours in exploration, number of behaviours in all."""
    explored = ((runs.steps >= 0) & (runs.steps < config.explore)).sum(1)
    total = (runs.steps >= 0).sum(1)
    policy = runs.weights.astype(bool)
    if policy.size:
        # What was learned from a behaviour is in the weights at the onset of the next.
        later = np.concatenate((runs.weights[:, 1:], runs.weights[:, -1:]), 1)
        policy = policies(later, config)
        each = np.arange(len(total))
        policy[each, total - 1] = policy[each, (total - 2).clip(min=0)]
    return success(runs.rewarded, policy, explored, total, needed_rewards(config)), explored, total


def proportion(flags: np.ndarray, among: np.ndarray | None = None) -> list[int]:
    """``[k, n]``"""
    flags = flags if among is None else flags[among]
    return [int(flags.sum()), len(flags)]


def describe(runs: Success) -> dict[str, Any]:
    """The entry of ``results.json`` for one kind of learner."""
    good = runs.found & runs.optimal & (runs.needed > 0)
    entry: dict[str, Any] = {
        "found": proportion(runs.found),
        "optimal_given_found": proportion(runs.optimal, runs.found),
        "optimal_given_not_found": proportion(runs.optimal, ~runs.found),
        "optimal_only_in_exploitation": proportion(runs.late, runs.found),
        "behaviors_to_find": summary(runs.first[runs.found] + 1),
        "behaviors_to_optimal": summary(runs.needed[good]),
        "behaviors_from_find_to_optimal": summary((runs.needed - runs.first - 1)[good]),
    }
    for key in list(entry):
        if isinstance(entry[key], list):
            entry[key + "_interval"] = list(wilson(*entry[key]))
    return entry

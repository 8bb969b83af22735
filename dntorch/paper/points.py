"""Many settings in one batch: each agent has numbers of its own, all share one compiled step."""

from typing import Any, NamedTuple

import numpy as np

from dntorch.paper.runs import runs_from_events
from dntorch.paper.statistics import wilson
from dntorch.paper.success import needed_rewards, success
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job


class Point(NamedTuple):
    """One setting: its name and the numbers that differ from the default."""

    name: str
    changes: dict[str, float]


def default(config: Config, path: str) -> float:
    """The number that an unchanged agent has."""
    if path in ("reward", "reward_duration", "noise"):
        return float(getattr(config, path))
    part, _, name = path.rpartition(".")
    return float(getattr(build_agent(config).get_submodule(part), name))


def job(name: str, config: Config, points: list[Point], runs: int) -> Job:
    """All points, ``runs`` agents each; the same chance for the same run of each point."""
    paths = sorted({path for point in points for path in point.changes})
    usual = {path: default(config, path) for path in paths}
    parameters = {
        path: tuple(p.changes.get(path, usual[path]) for p in points for _ in range(runs))
        for path in paths
    }
    agents = tuple(range(runs)) * len(points)
    rows = tuple(range(len(agents)))
    return Job(name, Group(config, agents, parameters=parameters, keep_weights=False, rows=rows))


def entry(events: dict[str, np.ndarray], config: Config, count: int) -> list[dict[str, Any]]:
    """What became of each block of ``count`` runs."""
    total = events["trouble"].shape[1]
    runs = runs_from_events(events, total)
    explored = ((runs.steps >= 0) & (runs.steps < config.explore)).sum(1)
    number = (runs.steps >= 0).sum(1)
    result = success(runs.rewarded, np.zeros(0, bool), explored, number, needed_rewards(config))
    entries = []
    for first in range(0, total, count):
        rows = slice(first, first + count)
        found, optimal = result.found[rows], result.optimal[rows]
        k, n = int((found & optimal).sum()), int(found.sum())
        largest = abs(events["weights_end"][rows])
        entries.append({
            "behaviors_in_exploration": float(explored[rows].mean()),
            "found": [n, count], "found_interval": wilson(n, count),
            "optimal_given_found": [k, n], "optimal_given_found_interval": wilson(k, n),
            "optimal_given_not_found": [int((optimal & ~found).sum()), count - n],
            "disagreements": int(runs.disagreements[rows].sum()),
            "steps_with_two_intentions": float(runs.trouble[0][rows].mean()),
            "steps_without_state": float(runs.trouble[1][rows].mean()),
            "largest_weight": float(np.nanmedian(largest.max((1, 2)))),
        })  # fmt: skip
    return entries

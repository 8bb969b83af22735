"""Many runs: seeds and configurations, and the tasks that they are cut into.

The unit is `run`: a picklable function of configurations that writes each run's folder and
returns its results. A run that has its ``results.json`` is finished and is never run again; one
that was killed goes on from its checkpoint. So a sweep may itself be killed and called again.
Who does the tasks: `dntorch.runs.workers`.
"""

import itertools
import json
from collections import Counter
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from dntorch.runs import train as learn
from dntorch.runs.config import Config
from dntorch.runs.together import INDIVIDUAL, Together
from dntorch.runs.trial import Trial

Table = list[dict[str, Any]]


class Task(NamedTuple):
    """What one worker is asked for: runs that are computed as one batch."""

    configs: tuple[Config, ...]
    root: Path
    save_every: int = 5_000


def grid(base: Config, seeds: list[int], settings: dict[str, list[Any]]) -> list[Config]:
    """Every seed with every combination of ``settings``, lists of values by name.

    >>> [config.seed for config in grid(Config(), [3, 4], {"noise": [5.0, 10.0]})]
    [3, 4, 3, 4]
    """
    known = {field.name for field in fields(Config)} - {"seed"}
    for name in settings.keys() - known:
        raise ValueError(f"{name!r} cannot be set: choose from {', '.join(sorted(known))}")
    combinations = itertools.product(*settings.values())
    chosen = [dict(zip(settings, values)) for values in combinations]
    return [replace(base, **values, seed=seed) for values in chosen for seed in seeds]


def plan(configs: list[Config], root: Path, batch: int = 1, save_every: int = 5_000) -> list[Task]:
    """Tasks of up to ``batch`` runs each, which have the same world, task and length.

    Raises:
        ValueError: two runs would have one folder; a batch of camera worlds.
    """
    twice = [name for name, n in Counter(name_of(c) for c in configs).items() if n > 1]
    if twice:
        raise ValueError(f"{twice[0]} would run twice: name each seed and value once")
    if batch > 1 and any(config.world != "nodes" for config in configs):
        raise ValueError(f"batch={batch}: only the world 'nodes' runs as a batch; leave it out")
    groups: dict[Config, list[Config]] = {}
    for config in configs:
        alike = replace(Config(), **{n: getattr(config, n) for n in shared(config)})
        groups.setdefault(alike, []).append(config)
    parts = [g[k : k + batch] for g in groups.values() for k in range(0, len(g), batch)]
    return [Task(tuple(part), root, save_every) for part in parts]


def shared(config: Config) -> list[str]:
    return [field.name for field in fields(config) if field.name not in INDIVIDUAL]


def name_of(config: Config) -> str:
    """Folder of a run: its seed and whatever differs from the defaults."""
    default = Config()
    others = {k: v for k, v in asdict(config).items() if v != getattr(default, k) and k != "seed"}
    return "-".join([f"seed{config.seed}", *(f"{k}={v}" for k, v in sorted(others.items()))])


# ------------------------------------------------------------------ the unit


def run(task: Task) -> Table:
    """Do the runs of a task that are not finished; the results of all, in order.

    Raises:
        ValueError: a folder holds a run with another configuration.
    """
    folders = [task.root / name_of(config) for config in task.configs]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    if len(folders) == 1:
        return [run_seed(task.configs[0], folders[0], task.save_every)]
    if not all((folder / learn.RESULTS).exists() for folder in folders):
        begun = folders[0] / "batch.pt"
        trials, seconds = Together(task.configs).train(begun, task.save_every)
        for trial, folder in zip(trials, folders):
            trial.save(folder / learn.CHECKPOINT)
            learn.write_results(trial, folder, learn.results(trial, trial.step, seconds))
        begun.unlink()
    return [_finished(config, folder) for config, folder in zip(task.configs, folders)]


def run_seed(config: Config, folder: Path, save_every: int = 5_000) -> dict[str, Any]:
    """One run, from its start or from where an earlier call was killed, to its end."""
    if not (folder / learn.RESULTS).exists():
        begun = folder / learn.CHECKPOINT
        trial = Trial.load(begun) if begun.exists() else Trial(config)
        before = trial.step
        seconds = learn.train(trial, folder, save_every)
        trial.close()
        learn.write_results(trial, folder, learn.results(trial, trial.step - before, seconds))
    return _finished(config, folder)


def _finished(config: Config, folder: Path) -> dict[str, Any]:
    results = json.loads((folder / learn.RESULTS).read_text())
    if results["config"] != asdict(config):
        raise ValueError(f"{folder} holds a run with other options: name another folder")
    return results

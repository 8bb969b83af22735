"""Many runs: seeds and configurations, and the batches that they are cut into.

The unit is `run`: a picklable function of a batch that writes each run's folder and returns
its results. A run that has its ``results.json`` is finished and is never run again; one that
was killed goes on from its checkpoint. So a sweep may itself be killed and called again.
Who does the work: `dntorch.runs.pool`.
"""

import itertools
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from dntorch import files
from dntorch.lock import owned
from dntorch.process import pays
from dntorch.runs import train as training
from dntorch.runs.config import Config
from dntorch.runs.group import INDIVIDUAL, Group
from dntorch.runs.pool import Report
from dntorch.runs.run import Run, Trial
from dntorch.runs.worlds import WORLDS

Table = list[dict[str, Any]]
PATIENCE = 20.0
"""s, for which a run waits for a worker of a sweep that was killed: it ends at once."""


class Batch(NamedTuple):
    """What one worker is asked for: runs that are computed as one batch."""

    configs: tuple[Config, ...]
    root: Path
    save_every: int = 5_000
    compiled: bool = True
    """where it pays"""


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


def plan(
    configs: list[Config],
    root: Path,
    batch: int = 1,
    save_every: int = 5_000,
    compiled: bool = True,
) -> list[Batch]:
    """Tasks of up to ``batch`` runs each, which have the same world, task and length.

    Raises:
        ValueError: two runs would have one folder; a batch of camera worlds.
    """
    twice = [name for name, n in Counter(name_of(c) for c in configs).items() if n > 1]
    if twice:
        raise ValueError(f"{twice[0]} would run twice: name each seed and value once")
    alone = [c.world for c in configs if not WORLDS[c.world].batched]
    if batch > 1 and alone:
        raise ValueError(f"batch={batch}: world={alone[0]!r} does not run as a batch; leave it out")
    groups: dict[Config, list[Config]] = {}
    for config in configs:
        alike = replace(Config(), **{n: getattr(config, n) for n in shared(config)})
        groups.setdefault(alike, []).append(config)
    parts = [g[k : k + batch] for g in groups.values() for k in range(0, len(g), batch)]
    return [Batch(tuple(part), root, save_every, compiled) for part in parts]


def shared(config: Config) -> list[str]:
    return [field.name for field in fields(config) if field.name not in INDIVIDUAL]


def name_of(config: Config) -> str:
    """Folder of a run: its seed and whatever differs from the defaults."""
    default = Config()
    others = {k: v for k, v in asdict(config).items() if v != getattr(default, k) and k != "seed"}
    return "-".join([f"seed{config.seed}", *(f"{k}={v}" for k, v in sorted(others.items()))])


# ------------------------------------------------------------------ the unit


def run(batch: Batch, report: Report = lambda steps: True) -> Table:
    """Do the runs of a batch that are not finished; the results of all, in order.

    Raises:
        ValueError: a folder holds a run with another configuration, or is in use.
    """
    folders = [batch.root / name_of(config) for config in batch.configs]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    if not all((folder / training.RESULTS).exists() for folder in folders):
        with ExitStack() as stack:
            for folder in folders:
                stack.enter_context(owned(folder, PATIENCE))
            _run(batch, folders, report)
    return [_finished(config, folder) for config, folder in zip(batch.configs, folders)]


def _run(batch: Batch, folders: list[Path], report: Report) -> None:
    together = len(folders) > 1
    compiled = batch.compiled and pays(batch.configs[0].steps)
    group = Group.of(batch.configs) if together else batch.configs[0]
    work = Run(group, compiled=compiled) if together else Trial(group, compiled)
    path = folders[0] / ("batch.pt" if together else training.CHECKPOINT)
    if path.exists():
        work.restore(path)
    before = work.step
    seconds = training.train(work, path, batch.save_every, lambda work: report(work.step))
    for k, folder in enumerate(folders):
        trial = work.member(k) if together else work
        if together:
            trial.save(folder / training.CHECKPOINT)
        training.write_results(trial, folder, training.results(trial, trial.step - before, seconds))
    work.close()
    if together:
        for file in (path, files.before(path)):
            file.unlink(missing_ok=True)


def _finished(config: Config, folder: Path) -> dict[str, Any]:
    results = training.read_results(folder)
    if results["config"] != asdict(config):
        raise ValueError(f"{folder} holds a run with other options: name another folder")
    return results

"""The paper's claims over many runs: run, measure, write down."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dntorch.files import write_json
from dntorch.paper.fast import at_the_rate, measure_fast
from dntorch.paper.populations import Population
from dntorch.paper.runs import runs_from_events
from dntorch.paper.study import Study, measure
from dntorch.runs.config import Config
from dntorch.runs.jobs import Job, run_groups, total_steps
from dntorch.runs.worlds import WORLDS


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
    events = run_groups(groups(config, runs), parts, processes, progress)
    tables = {name: runs_from_events(each, runs) for name, each in events.items()}
    study = measure(config, tables["neural"], tables.get("single"))
    study.results["fast"] = measure_fast(tables["fast"], config) if "fast" in tables else None
    study.results["runs"], study.results["duration_seconds"] = runs, time.monotonic() - began
    write_json(folder / "results.json", study.results)
    return study


def groups(config: Config, runs: int) -> list[Job]:
    """The agents of the paper; where many run as a batch, a trace of one item and a fast one."""
    row, numbers = WORLDS[config.world], tuple(range(runs))
    who = {"agents": numbers}
    if not row.numbered:
        who = {"seeds": tuple(config.seed + k for k in numbers), "rows": numbers}
    jobs = [Job("neural", Population(config, **who))]
    if row.batched:
        jobs.append(Job("single", Population(config, **who, variant="single_item")))
        jobs.append(Job("fast", Population(at_the_rate(config), **who)))
    return jobs


def steps_to_take(config: Config, runs: int, processes: int) -> int:
    """The sum that the progress of `reproduce` reaches."""
    return total_steps(groups(config, runs), processes)

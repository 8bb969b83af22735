"""The paper's claims over many runs: run, measure, write down."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from dntorch.files import write_json
from dntorch.paper.camera import camera_runs, run_camera
from dntorch.paper.runs import runs_from_events
from dntorch.paper.study import Study, measure
from dntorch.runs.batches import Job, run_all, run_groups, total_steps
from dntorch.runs.config import Config
from dntorch.runs.group import Group


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
    write_json(folder / "results.json", study.results)
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

"""The command that runs seeds and configurations side by side."""

import math
import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dntorch.commands.cluster import RAY, SLURM
from dntorch.commands.common import (
    MOST_PROCESSES,
    MOST_RUNS,
    Computing,
    new_folder,
    progress_bar,
    refuse_options,
    stoppable,
)
from dntorch.commands.grid import SEEDS, SET
from dntorch.commands.kinds import NEW_FOLDER, whole
from dntorch.commands.options import (
    CHECKPOINT_EVERY,
    COMPILE,
    build_config,
    exploration_is_open,
    explored,
    options_of_a_run,
)
from dntorch.extras import require
from dntorch.lock import owned
from dntorch.runs.config import Config
from dntorch.runs.worlds import WORLDS

if TYPE_CHECKING:
    from dntorch.runs.pool import Finished
    from dntorch.runs.sweep import Table

BATCHED = " and ".join(name for name, row in WORLDS.items() if row.batched)


@click.command(cls=Computing)
@options_of_a_run(without=("seed",))
@SEEDS
@SET
@click.option(
    "--processes",
    type=whole(1, MOST_PROCESSES),
    help="Side by side.  [default: one a core]",
)
@click.option(
    "--batch",
    type=whole(1, MOST_RUNS),
    default=1,
    show_default=True,
    help=f"Runs that one process computes as a batch, in the worlds {BATCHED}.",
)
@RAY
@SLURM
@click.option(
    "--retries",
    type=whole(0, 1000),
    default=3,
    show_default=True,
    help="How often a run may be killed and go on.",
)
@CHECKPOINT_EVERY
@click.option(
    "--out",
    type=NEW_FOLDER,
    default=Path("runs/sweep"),
    show_default=True,
    help="Folder of the sweep; called again, it goes on with what is not finished.",
)
@COMPILE
@click.pass_context
def sweep(
    context, file, seeds, settings, out, batch, checkpoint_every, compiled, **options
) -> None:
    """Train many agents and write one table.

    Each run has a folder of its own with results.json, checkpoint.pt and record.npz; table.csv,
    table.jsonl and, where pyarrow is, table.parquet hold a row per run.
    """
    refuse_options(context, context.params.keys() - settings, "is varied by --set as well")
    where = {name: options.pop(name) for name in ("processes", "ray", "slurm", "retries")}
    require("numpy", "tqdm")
    if where["slurm"] and where["ray"]:
        raise ValueError("--slurm and --ray: choose one")
    count = len(seeds) * math.prod(map(len, settings.values()))
    if count > MOST_RUNS:
        raise ValueError(f"--seeds and --set make {count:,} runs: give at most {MOST_RUNS:,}")
    from dntorch.runs import sweep as sweeps
    from dntorch.runs import table

    configs = _configs(file, options, seeds, settings)
    _check(configs)
    tasks = sweeps.plan(configs, out.absolute(), batch, checkpoint_every, compiled)
    running = _start(tasks, out, **where)
    with owned(out), stoppable("the same command goes on with the runs that are left"):
        rows, failed = _follow(running, len(configs))
    order = {sweeps.name_of(config): k for k, config in enumerate(configs)}
    rows.sort(key=lambda one: order[sweeps.name_of(Config(**one["config"]))])
    for path in table.write(out, rows):
        click.echo(f"table: {path}")
    if failed:
        raise ValueError(f"{len(failed)} of {len(configs)} runs failed, the first: {failed[0]}")


def _configs(file, options, seeds, settings) -> list[Config]:
    """The runs; each explores as one of its own length where nobody says how long."""
    from dntorch.runs import sweep as sweeps

    first = {name: values[0] for name, values in settings.items()}
    unsaid = (
        "steps" in settings
        and "explore" not in settings
        and exploration_is_open(options["autonomous"])
    )
    if unsaid:
        first["steps"] = min(settings["steps"])
    configs = sweeps.grid(build_config(file, options | first), seeds, settings)
    if not unsaid:
        return configs
    return [replace(c, explore=explored(c.steps, options["autonomous"])) for c in configs]


def _check(configs: list[Config]) -> None:
    """Raise for values that make no agent or no world, before there is a folder."""
    from dntorch.runs.build import build_agent

    for world in dict.fromkeys(config.world for config in configs):
        require(*WORLDS[world].packages, instead="give --world ring")
    for config in dict.fromkeys(replace(config, seed=0) for config in configs):
        build_agent(config)


def _start(tasks, out: Path, processes, ray, slurm, retries) -> "Iterator[Finished]":
    from tqdm import tqdm

    from dntorch.runs import pool, sweep

    new_folder(out, ())
    processes = processes or len(os.sched_getaffinity(0))
    if slurm:
        return pool.on_slurm(sweep.run, tasks, out)
    if ray:
        return pool.on_ray(sweep.run, tasks, None if ray == "local" else ray, retries, processes)
    return pool.in_processes(sweep.run, tasks, processes, retries, tqdm.write)


def _follow(running: "Iterator[Finished]", total: int) -> "tuple[Table, list[str]]":
    from dntorch.runs.sweep import name_of

    rows: Table = []
    failed: list[str] = []
    with closing(running), progress_bar(total=total, unit="run") as bar:
        for finished in running:
            rows += finished.result or []
            if finished.error:
                names = map(name_of, finished.task.configs)
                failed += [f"{name}: {finished.error}" for name in names]
            bar.update(len(finished.task.configs))
            optimal = sum(one["optimal_at_end"] for one in rows)
            bar.set_postfix(optimal=optimal, failed=len(failed))
    return rows, failed

"""The command that runs seeds and configurations side by side."""

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from dntorch.process import end_when_asked
from dntorch.runs import pool, table
from dntorch.runs import sweep as sweeps
from dntorch.runs.config import WORLDS, Config


@click.command()
@click.option("--seeds", default="0-9", show_default=True, help="Such as 0-99 or 1,5,7.")
@click.option(
    "--world", type=click.Choice(WORLDS), default="epuck", show_default=True, help="As in learn."
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE[,VALUE...]",
    help="A value of the run, or several to combine: learning_rate=0.03,0.06.",
)
@click.option(
    "--processes",
    type=click.IntRange(1),
    help="Side by side.  [default: one a core]",
)
@click.option(
    "--batch",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Runs of the world nodes that one process computes as a batch.",
)
@click.option(
    "--ray", metavar="ADDRESS", help="On a Ray cluster: its address, or local to start one here."
)
@click.option("--slurm", is_flag=True, help="As an array of Slurm jobs (submitit).")
@click.option(
    "--retries",
    type=click.IntRange(0),
    default=3,
    show_default=True,
    help="How often a run may be killed and go on.",
)
@click.option(
    "--checkpoint-every",
    type=click.IntRange(1),
    default=5_000,
    show_default=True,
    help="Control steps between two checkpoints.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs/sweep"),
    show_default=True,
    help="Folder of the sweep; called again, it goes on with what is not finished.",
)
def sweep(seeds, world, settings, processes, batch, ray, slurm, retries, checkpoint_every, out):
    """Train many agents and write one table.

    Each run has a folder of its own with results.json, checkpoint.pt and record.npz; table.csv,
    table.jsonl and, where pyarrow is, table.parquet hold a row a run.
    """
    configs = sweeps.grid(Config(world=world), _seeds(seeds), dict(map(_setting, settings)))
    tasks = sweeps.plan(configs, out.absolute(), batch, checkpoint_every)
    out.mkdir(parents=True, exist_ok=True)
    processes = processes or len(os.sched_getaffinity(0))
    if slurm and ray:
        raise ValueError("--slurm and --ray: choose one")
    if slurm:
        running = pool.on_slurm(sweeps.run, tasks, out)
    elif ray:
        running = pool.on_ray(
            sweeps.run, tasks, None if ray == "local" else ray, retries, processes
        )
    else:
        running = pool.in_processes(sweeps.run, tasks, processes, retries, tqdm.write)
    end_when_asked()
    rows, failed = _follow(running, len(configs))
    order = {sweeps.name_of(config): k for k, config in enumerate(configs)}
    rows.sort(key=lambda one: order[sweeps.name_of(Config(**one["config"]))])
    for path in table.write(out, rows):
        click.echo(f"table: {path}")
    if failed:
        raise ValueError(f"{len(failed)} of {len(configs)} runs failed, the first: {failed[0]}")


def _follow(running: Iterator[pool.Finished], total: int) -> tuple[sweeps.Table, list[str]]:
    rows: sweeps.Table = []
    failed: list[str] = []
    try:
        with closing(running), tqdm(total=total, unit="run") as bar:
            for finished in running:
                rows += finished.result or []
                if finished.error:
                    names = map(sweeps.name_of, finished.task.configs)
                    failed += [f"{name}: {finished.error}" for name in names]
                bar.update(len(finished.task.configs))
                optimal = sum(one["optimal_at_end"] for one in rows)
                bar.set_postfix(optimal=optimal, failed=len(failed))
    except KeyboardInterrupt:
        click.echo(f"stopped with {len(rows)} of {total} runs finished; the same command goes on "
                   "with the others", err=True)  # fmt: skip
        raise
    return rows, failed


def _seeds(text: str) -> list[int]:
    try:
        parts = [part.partition("-") for part in text.split(",")]
        ranges = [range(int(a), int(b or a) + 1) for a, _, b in parts]
    except ValueError:
        raise ValueError(f"--seeds={text!r}: give numbers such as 0-9 or 1,5,7") from None
    seeds = [seed for numbers in ranges for seed in numbers]
    if not seeds:
        raise ValueError(f"--seeds={text!r} names none: give the smaller number first")
    return seeds


def _setting(text: str) -> tuple[str, list[Any]]:
    name, _, values = text.partition("=")
    kind = type(getattr(Config, name, ""))
    try:
        return name, [kind(value) for value in values.split(",")]
    except ValueError:
        raise ValueError(f"--set {text}: {name} is a {kind.__name__}, such as "
                         f"{getattr(Config, name)}") from None  # fmt: skip

"""The command that runs seeds and configurations side by side."""

import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dntorch.commands.common import Computing, refuse_options
from dntorch.commands.options import COMPILE, build_config, options_of_a_run
from dntorch.process import end_when_asked
from dntorch.runs.config import Config
from dntorch.runs.settings import FIELDS, WORDS

if TYPE_CHECKING:
    from dntorch.runs.pool import Finished
    from dntorch.runs.sweep import Table


@click.command(cls=Computing)
@options_of_a_run(without=("seed",))
@click.option("--seeds", default="0-9", show_default=True, help="Such as 0-99 or 1,5,7.")
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
@COMPILE
@click.pass_context
def sweep(
    context, file, seeds, settings, out, batch, checkpoint_every, compiled, **options
) -> None:
    """Train many agents and write one table.

    Each run has a folder of its own with results.json, checkpoint.pt and record.npz; table.csv,
    table.jsonl and, where pyarrow is, table.parquet hold a row per run.
    """
    from dntorch.runs import sweep as sweeps
    from dntorch.runs import table

    varied = dict(map(_setting, settings))
    refuse_options(context, context.params.keys() - varied, "is varied by --set as well")
    where = {name: options.pop(name) for name in ("processes", "ray", "slurm", "retries")}
    first = {name: values[0] for name, values in varied.items() if name in options}
    configs = sweeps.grid(build_config(file, options | first), _seeds(seeds), varied)
    _check(configs)
    tasks = sweeps.plan(configs, out.absolute(), batch, checkpoint_every, compiled)
    running = _start(tasks, out, **where)
    end_when_asked()
    rows, failed = _follow(running, len(configs))
    order = {sweeps.name_of(config): k for k, config in enumerate(configs)}
    rows.sort(key=lambda one: order[sweeps.name_of(Config(**one["config"]))])
    for path in table.write(out, rows):
        click.echo(f"table: {path}")
    if failed:
        raise ValueError(f"{len(failed)} of {len(configs)} runs failed, the first: {failed[0]}")


def _check(configs: list[Config]) -> None:
    """Raise for values that make no agent, before there is a folder."""
    from dntorch.runs.build import build_agent

    for config in dict.fromkeys(replace(config, seed=0) for config in configs):
        build_agent(config)


def _start(tasks, out: Path, processes, ray, slurm, retries) -> "Iterator[Finished]":
    from tqdm import tqdm

    from dntorch.runs import pool, sweep

    if slurm and ray:
        raise ValueError("--slurm and --ray: choose one")
    out.mkdir(parents=True, exist_ok=True)
    processes = processes or len(os.sched_getaffinity(0))
    if slurm:
        return pool.on_slurm(sweep.run, tasks, out)
    if ray:
        return pool.on_ray(sweep.run, tasks, None if ray == "local" else ray, retries, processes)
    return pool.in_processes(sweep.run, tasks, processes, retries, tqdm.write)


def _follow(running: "Iterator[Finished]", total: int) -> "tuple[Table, list[str]]":
    from tqdm import tqdm

    from dntorch.runs.sweep import name_of

    rows: Table = []
    failed: list[str] = []
    try:
        with closing(running), tqdm(total=total, unit="run") as bar:
            for finished in running:
                rows += finished.result or []
                if finished.error:
                    names = map(name_of, finished.task.configs)
                    failed += [f"{name}: {finished.error}" for name in names]
                bar.update(len(finished.task.configs))
                optimal = sum(one["optimal_at_end"] for one in rows)
                bar.set_postfix(optimal=optimal, failed=len(failed))
    except KeyboardInterrupt:
        finished = f"stopped with {len(rows)} of {total} runs finished"
        click.echo(f"{finished}; the same command goes on with the others", err=True)
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
    kind = FIELDS[name].type if name in FIELDS else str
    try:
        return name, [kind(value) for value in values.split(",")]
    except ValueError:
        example = f"give {WORDS[kind]}, such as {FIELDS[name].default}"
        raise ValueError(f"--set {text}: {example}") from None

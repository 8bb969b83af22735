"""Groups of runs in processes, with one progress bar, stoppable and resumable."""

import multiprocessing
import signal
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from dntorch import files
from dntorch.process import can_compile, settle
from dntorch.runs.group import Group
from dntorch.runs.population import Population, run


class Job(NamedTuple):
    """A group of runs under a name; the name is that of its files."""

    name: str
    group: Group


class Shared(NamedTuple):
    """What the main process and the workers both see."""

    steps: Any
    """steps done, one number a job"""
    stop: Any
    """event: save and end"""


_shared: Shared


def split(job: Job, parts: int) -> list[Job]:
    """The same runs in batches for ``parts`` processes."""
    group, count = job.group, len(job.group.agents)
    edges = [count * k // parts for k in range(parts + 1)]
    jobs = []
    for k, (first, last) in enumerate(zip(edges, edges[1:])):
        if last > first:
            part = replace(
                group,
                agents=group.agents[first:last],
                rows=group.rows[first:last],
                parameters={name: v[first:last] for name, v in group.parameters.items()},
            )
            jobs.append(Job(f"{job.name}-{k}", part))
    return jobs


def _begin(shared: Shared) -> None:
    global _shared
    _shared = shared
    # Ctrl-C reaches all processes: the main one decides, workers save when it says so.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    settle()


def report(index: int, steps: int) -> bool:
    """Called in a worker: job ``index`` has come this far; whether it is to go on."""
    _shared.steps[index] = steps
    return not _shared.stop.is_set()


def _population(index: int, job: Job, folder: Path) -> bool:
    done = folder / f"{job.name}.npz"
    if not done.exists():
        torch.compiler.reset()  # one worker compiles for many groups
        population = Population(job.group, compiled=can_compile())
        if not run(population, folder / f"{job.name}.pt", progress=partial(report, index)):
            return False
        events = population.results()
        description = np.array(job.group.description())
        files.write_atomically(done, lambda file: np.savez(file, group=description, **events))
    report(index, job.group.config.steps)
    return True


def run_all(
    work: Callable[..., bool],
    jobs: list,
    folder: Path,
    processes: int,
    progress: Callable[[int], Any] = lambda steps: None,
) -> None:
    """``work(index, job, folder)`` for each job; ``progress`` hears the sum of steps done.

    Raises:
        KeyboardInterrupt: after all workers have saved.
    """
    folder.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    shared = Shared(context.Array("q", len(jobs)), context.Event())
    with ProcessPoolExecutor(processes, context, _begin, (shared,)) as pool:
        futures = [pool.submit(work, k, job, folder) for k, job in enumerate(jobs)]
        try:
            while not all(future.done() for future in futures):
                progress(sum(shared.steps))
                failed = [f for f in futures if f.done() and f.exception()]
                if failed:  # the others save and end; then the error is raised below
                    shared.stop.set()
                    pool.shutdown(cancel_futures=True)
                    failed[0].result()
                time.sleep(0.3)
        except KeyboardInterrupt:
            shared.stop.set()
            pool.shutdown(cancel_futures=True)
            raise
        for future in futures:
            future.result()
    progress(sum(shared.steps))


def run_groups(
    groups: list[Job],
    folder: Path,
    processes: int = 2,
    progress: Callable[[int], Any] = lambda steps: None,
    batches: int | None = None,
) -> dict[str, dict[str, np.ndarray]]:
    """Events of each job, cut in ``batches`` (one a process); what is done already is read.

    Raises:
        ValueError: ``folder`` holds runs of another group under the same name.
    """
    parts = [part for job in groups for part in split(job, batches or processes)]
    if not all((folder / f"{part.name}.npz").exists() for part in parts):
        run_all(_population, parts, folder, processes, progress)
    results: dict[str, dict[str, np.ndarray]] = {}
    for job in groups:
        events = [_read(part, folder) for part in split(job, batches or processes)]
        results[job.name] = {
            key: np.concatenate([e[key] for e in events], -1 if key == "trouble" else 0)
            for key in events[0]
        }
    return results


def _read(part: Job, folder: Path) -> dict[str, np.ndarray]:
    path = folder / f"{part.name}.npz"
    events = dict(np.load(path))
    part.group.check(str(events.pop("group", "")), path)
    return events


def total_steps(groups: list[Job], processes: int = 2) -> int:
    """The sum that ``progress`` reaches."""
    return sum(part.group.config.steps for job in groups for part in split(job, processes))

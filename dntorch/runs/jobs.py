"""Groups of runs under names, remembered as events: cut into batches, done in processes."""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from dntorch import files
from dntorch.lock import owned
from dntorch.process import pays
from dntorch.runs.group import Group
from dntorch.runs.pool import Report, in_processes
from dntorch.runs.run import Run
from dntorch.runs.train import train
from dntorch.runs.worlds import WORLDS

LARGEST = 1024
"""Agents of a batch at most: more are no faster, and a checkpoint grows with them."""
SAVE_EVERY = 10_000


class Job(NamedTuple):
    """A group of runs under a name; the name is that of its files."""

    name: str
    group: Group


class Piece(NamedTuple):
    """What one worker is asked for."""

    job: Job
    folder: Path

    @property
    def done(self) -> Path:
        return self.folder / f"{self.job.name}.npz"


def split(job: Job, parts: int) -> list[Job]:
    """The same runs in batches for ``parts`` processes; one by one where there is no batch."""
    group, count = job.group, len(job.group.agents or job.group.seeds)
    parts = max(parts, -(-count // LARGEST))
    if not WORLDS[group.config.world].batched:
        one = replace(group, agents=(), seeds=(), parameters={}, rows=())
        alone = [replace(one, config=group.member(k), rows=(k,)) for k in range(count)]
        return [Job(f"{job.name}-{k}", each) for k, each in enumerate(alone)]
    edges = [count * k // parts for k in range(parts + 1)]
    rows = group.rows or group.agents or tuple(range(count))
    return [
        Job(f"{job.name}-{k}", replace(group.part(first, last), rows=rows[first:last]))
        for k, (first, last) in enumerate(zip(edges, edges[1:]))
        if last > first
    ]


def work(piece: Piece, report: Report) -> None:
    """Runs from their start, or from where they stopped, to their end."""
    group = piece.job.group
    if not piece.done.exists():
        torch.compiler.reset()  # one worker compiles for many groups
        path, compiled = piece.done.with_suffix(".pt"), pays(group.config.steps)
        run = Run(group, events=True, compiled=compiled)
        if path.exists():
            run.restore(path)
        train(run, path, SAVE_EVERY, lambda run: report(run.step))
        run.close()
        description = np.array(group.description())
        events = run.memory.joined()
        files.write_atomically(piece.done, lambda file: np.savez(file, group=description, **events))
    report(group.config.steps)


def run_groups(
    jobs: list[Job],
    folder: Path,
    processes: int = 2,
    progress: Callable[[int], Any] = lambda steps: None,
    batches: int | None = None,
) -> dict[str, dict[str, np.ndarray]]:
    """Events of each job, cut in ``batches`` (one a process); what is done already is read.

    Raises:
        ValueError: ``folder`` holds runs of another group under the same name or a damaged
            file, or another process works there.
        RuntimeError: a worker failed; the others have saved.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parts = {job.name: split(job, batches or processes) for job in jobs}
    pieces = [Piece(part, folder) for each in parts.values() for part in each]
    if not all(piece.done.exists() for piece in pieces):
        with owned(folder):
            _do(pieces, processes, progress)
    return {name: _joined([_read(part, folder) for part in each]) for name, each in parts.items()}


def _do(pieces: list[Piece], processes: int, progress: Callable[[int], Any]) -> None:
    missing = [piece for piece in pieces if not piece.done.exists()]
    before = sum(p.job.group.config.steps for p in pieces) - sum(
        p.job.group.config.steps for p in missing
    )
    for finished in in_processes(
        work, missing, processes, progress=lambda steps: progress(before + steps)
    ):
        if finished.error:
            raise RuntimeError(f"{finished.task.job.name}: {finished.error}")


def _joined(events: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {
        key: np.concatenate([e[key] for e in events], -1 if key == "trouble" else 0)
        for key in events[0]
    }


def _read(part: Job, folder: Path) -> dict[str, np.ndarray]:
    path = folder / f"{part.name}.npz"
    try:
        events = dict(np.load(io.BytesIO(path.read_bytes())))
    except Exception as error:  # a damaged archive: NumPy has many words for that
        raise ValueError(
            f"{path} is damaged ({error}): remove it, and the runs go on from their checkpoint"
        ) from error
    part.group.check(str(events.pop("group", "")), path)
    return events


def total_steps(jobs: list[Job], processes: int = 2) -> int:
    """The sum that ``progress`` reaches."""
    return sum(part.group.config.steps for job in jobs for part in split(job, processes))

"""Many runs: seeds and configurations, in a batch, over processes or over machines.

The unit is `run`: a picklable function of configurations that writes each run's folder and
returns its results. A run that has its ``results.json`` is finished and is never run again; one
that was killed goes on from its checkpoint. So a sweep may itself be killed and called again.
"""

import itertools
import json
import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields, replace
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, NamedTuple

import torch

from dntorch.experiments import learn
from dntorch.experiments.config import Config
from dntorch.experiments.together import INDIVIDUAL, Together
from dntorch.experiments.trial import Trial

Table = list[dict[str, Any]]


class Task(NamedTuple):
    """What one worker is asked for: runs that are computed as one batch."""

    configs: tuple[Config, ...]
    root: Path
    save_every: int = 5_000


class Finished(NamedTuple):
    """What became of a task."""

    task: Task
    results: Table
    error: str = ""


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


def settle() -> None:
    """Settings of a worker's process, those of the command line."""
    torch.set_flush_denormal(True)
    torch.set_num_threads(1)


def _begin() -> None:
    settle()
    # Ctrl-C reaches all processes of a terminal: the main one passes it on as SIGTERM.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_settled(task: Task) -> Table:
    settle()
    return run(task)


# ------------------------------------------------------------------ who does the work


def in_processes(
    tasks: list[Task],
    processes: int,
    retries: int = 3,
    notice: Callable[[str], Any] = print,
    unit: Callable[[Task], Table] = run,
) -> Iterator[Finished]:
    """Tasks as they finish, over a pool of processes.

    A worker that is killed takes its pool with it, but no finished run: a new pool begins
    with what was running, up to ``retries`` times for each task. Whoever stops listening,
    as after Ctrl-C, stops the workers; each saves where it stands.
    """
    waiting, killed = deque(tasks), Counter[Task]()
    while waiting:
        running: dict[Any, Task] = {}
        try:
            with ProcessPoolExecutor(processes, get_context("spawn"), _begin) as pool, _stopping():
                while waiting or running:
                    while waiting and len(running) < processes:
                        running[pool.submit(_one, unit, waiting[0])] = waiting[0]
                        waiting.popleft()
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        finished = _outcome(running[future], future.result)
                        del running[future]
                        yield finished
        except BrokenProcessPool:
            notice(f"a worker was killed; {len(running)} go on from their checkpoints")
            for task in running.values():
                killed[task] += 1
                if killed[task] > retries:
                    yield Finished(task, [], f"killed {killed[task]} times")
                else:
                    waiting.append(task)


def _one(unit: Callable[[Task], Table], task: Task) -> Table:
    try:
        return unit(task)
    except KeyboardInterrupt:
        os._exit(130)  # saved; one that went back for more could wait for ever for a dead one


@contextmanager
def _stopping() -> Iterator[None]:
    """Stop all workers if this process was asked to end: a pool would wait for their runs."""
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        for worker in active_children():
            worker.terminate()
        raise


def on_ray(
    tasks: list[Task], address: str | None = None, retries: int = 3, processes: int | None = None
) -> Iterator[Finished]:
    """Tasks as they finish, on a Ray cluster: that at ``address``, or one started here.

    One Ray task each; Ray itself begins again what a killed worker leaves. Machines without a
    file system in common keep their own checkpoints; results come back all the same.
    """
    import ray

    begun = not ray.is_initialized()
    if begun:
        here = {} if address else {"num_cpus": processes, "include_dashboard": False}
        former = signal.getsignal(signal.SIGTERM)
        ray.init(address=address or "local", log_to_driver=False, **here)
        with suppress(ValueError):  # Ray's own, in a main thread, would end it without a word
            signal.signal(signal.SIGTERM, former)
    try:
        remote = ray.remote(num_cpus=1, max_retries=retries)(run_settled)
        running = {remote.remote(task): task for task in tasks}
        while running:
            (reference,), _ = ray.wait(list(running), num_returns=1)
            yield _outcome(running.pop(reference), lambda ref=reference: ray.get(ref))
    finally:
        if begun:
            ray.shutdown()


def on_slurm(
    tasks: list[Task], root: Path, minutes: int = 600, cluster: str | None = None
) -> Iterator[Finished]:
    """Tasks as they finish, as an array of Slurm jobs (through submitit).

    A job that runs out of time is queued again and goes on from its checkpoint.
    """
    import submitit

    executor = submitit.AutoExecutor(root / "slurm", cluster=cluster)
    executor.update_parameters(timeout_min=minutes, cpus_per_task=1, name="dntorch")
    jobs = executor.map_array(run_settled, tasks)
    asked = {job.job_id: task for job, task in zip(jobs, tasks)}
    for job in submitit.helpers.as_completed(jobs):
        yield _outcome(asked[job.job_id], job.result)


def _outcome(task: Task, result: Callable[[], Table]) -> Finished:
    try:
        return Finished(task, result())
    except BrokenProcessPool:
        raise
    except Exception as error:
        return Finished(task, [], f"{type(error).__name__}: {error}")

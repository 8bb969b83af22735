"""Who does the tasks of a sweep: processes, a Ray cluster, a Slurm queue.

Each gives the tasks as they finish, whatever became of them, and loses no finished run.
"""

import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, NamedTuple

from dntorch.process import settle
from dntorch.runs.sweep import Table, Task, run


class Finished(NamedTuple):
    """What became of a task."""

    task: Task
    results: Table
    error: str = ""


def _begin() -> None:
    settle()
    # Ctrl-C reaches all processes of a terminal: the main one passes it on as SIGTERM.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_settled(task: Task) -> Table:
    settle()
    return run(task)


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

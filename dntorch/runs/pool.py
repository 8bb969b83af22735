"""The one pool of processes: work side by side, with progress, that loses nothing.

A piece of work is a picklable task and a function ``work(task, report) -> result``; it calls
``report(steps)`` now and then, which says whether to go on, and saves where it stands when it
is told to stop. Who does it: processes here, a Ray cluster, a Slurm queue.
"""

import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from dntorch.process import REQUESTS, settle


class Report(Protocol):
    """Called by work: it has come this far; whether it is to go on."""

    def __call__(self, steps: int) -> bool: ...


Work = Callable[[Any, Report], Any]
LOOK = 0.2
"""s, from one look at the workers to the next."""


class Stopped(Exception):
    """Work was told to stop and has saved where it stands."""


class Finished(NamedTuple):
    """What became of a task."""

    task: Any
    result: Any
    error: str = ""


class Shared(NamedTuple):
    """What the main process and its workers both see; without locks, which one that is killed
    would hold for ever."""

    steps: Any
    """steps done, one number a task"""
    stop: Any
    """not 0: save and end"""


_shared: Shared


def _begin(shared: Shared) -> None:
    global _shared
    _shared = shared
    settle()
    # These reach all processes of a terminal: the main one decides, workers save when told.
    for number in REQUESTS:
        if number is not signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)


def _one(work: Work, task: Any, number: int) -> Any:
    def report(steps: int) -> bool:
        _shared.steps[number] = steps
        return not _shared.stop.value

    if _shared.stop.value:
        raise Stopped
    try:
        return work(task, report)
    except KeyboardInterrupt:  # a broken pool ends its other workers with SIGTERM: saved
        os._exit(130)  # one that went back for more could wait for ever for a dead one


def in_processes(
    work: Work,
    tasks: list[Any],
    processes: int,
    retries: int = 3,
    notice: Callable[[str], Any] = print,
    progress: Callable[[int], Any] = lambda steps: None,
) -> Iterator[Finished]:
    """Tasks as they finish, over a pool of processes; ``progress`` hears the sum of steps done.

    A worker that is killed takes its pool with it, but no finished work: a new pool begins
    with what was running, up to ``retries`` times for each task. Whoever stops listening,
    as after Ctrl-C, waits until each worker has saved where it stands.
    """
    context = get_context("spawn")
    shared = Shared(context.RawArray("q", len(tasks)), context.RawValue("b"))
    waiting, killed = deque(range(len(tasks))), Counter[int]()
    while waiting:
        running: dict[Future, int] = {}
        try:
            with ProcessPoolExecutor(processes, context, _begin, (shared,)) as pool:
                try:
                    while waiting or running:
                        while waiting and len(running) < processes:
                            number = waiting[0]  # until it is submitted: a pool may be broken
                            running[pool.submit(_one, work, tasks[number], number)] = number
                            waiting.popleft()
                        for future in [future for future in running if future.done()]:
                            finished = _outcome(tasks[running[future]], future.result)
                            del running[future]
                            yield finished
                        progress(sum(shared.steps))
                        wait(running, LOOK, FIRST_COMPLETED)
                except (KeyboardInterrupt, GeneratorExit):
                    shared.stop.value = 1
                    raise
        except BrokenProcessPool:
            notice(f"a worker was killed; {len(running)} go on from their checkpoints")
            for number in running.values():
                killed[number] += 1
                if killed[number] > retries:
                    yield Finished(tasks[number], None, f"killed {killed[number]} times")
                else:
                    waiting.append(number)


def _on(_steps: int) -> bool:
    return True


def settled(work: Work, task: Any) -> Any:
    """Work in a process that somebody else began."""
    settle()
    return work(task, _on)


def on_ray(
    work: Work,
    tasks: list[Any],
    address: str | None = None,
    retries: int = 3,
    processes: int | None = None,
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
        try:
            ray.init(address=address or "local", log_to_driver=False, **here)
        except ConnectionError as error:
            reason = str(error).split(". ")[0]
            raise ConnectionError(
                f"address={address!r}: {reason}; name a cluster that runs, or local"
            ) from error
        with suppress(ValueError):  # Ray's own, in a main thread, would end it without a word
            signal.signal(signal.SIGTERM, former)
    try:
        remote = ray.remote(num_cpus=1, max_retries=retries)(settled)
        running = {remote.remote(work, task): task for task in tasks}
        while running:
            (reference,), _ = ray.wait(list(running), num_returns=1)
            yield _outcome(running.pop(reference), lambda ref=reference: ray.get(ref))
    finally:
        if begun:
            ray.shutdown()


def on_slurm(
    work: Work, tasks: list[Any], root: Path, minutes: int = 600, cluster: str | None = None
) -> Iterator[Finished]:
    """Tasks as they finish, as an array of Slurm jobs (through submitit).

    A job that runs out of time is queued again and goes on from its checkpoint.
    """
    import submitit

    executor = submitit.AutoExecutor(root / "slurm", cluster=cluster)
    executor.update_parameters(timeout_min=minutes, cpus_per_task=1, name="dntorch")
    jobs = executor.map_array(settled, [work] * len(tasks), tasks)
    asked = {job.job_id: task for job, task in zip(jobs, tasks)}
    for job in submitit.helpers.as_completed(jobs):
        yield _outcome(asked[job.job_id], job.result)


def _outcome(task: Any, result: Callable[[], Any]) -> Finished:
    try:
        return Finished(task, result())
    except BrokenProcessPool:
        raise
    except Exception as error:
        return Finished(task, None, f"{type(error).__name__}: {error}")

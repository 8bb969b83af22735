"""Settings of a process, requests to end it, and what it was built from."""

import contextlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

STREAMS = {"stdin": "r", "stdout": "w", "stderr": "w"}
"""Names in ``sys`` and modes, in the order of their descriptors, 0 to 2."""


def signals(names: str) -> tuple[signal.Signals, ...]:
    """Those of the names that this system has: Windows has few, and macOS not all."""
    return tuple(getattr(signal, name) for name in names.split() if hasattr(signal, name))


REQUESTS = signals("SIGINT SIGTERM SIGHUP SIGQUIT")
"""Requests to end: Ctrl-C, ``kill``, a closed terminal or connection, Ctrl-backslash."""

FOLLOWING = "follows-parent"


def settle(threads: int = 1) -> None:
    """Settings that every process of a run has, whoever starts it.

    Silent cells must not decay into slow denormal numbers, and operations on a few nodes are
    fastest, and always the same, on one thread. A process of multiprocessing ends with the one
    that started it, even when that is killed; without this it waits for work for ever.
    """
    import torch  # 2 s: the command line asks for the rest of this file without it

    if multiprocessing.parent_process() and FOLLOWING not in [
        t.name for t in threading.enumerate()
    ]:
        threading.Thread(target=_follow_parent, daemon=True, name=FOLLOWING).start()
    torch.set_flush_denormal(True)
    torch.set_num_threads(threads)


def occupy_streams() -> None:
    """Put the null device in place of each standard stream that was closed before the start.

    Or the next file that is opened takes its number, and what C code prints goes into it.
    """
    for number in range(len(STREAMS)):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number


def open_streams() -> None:
    """The same, and ``sys`` has all three: what is printed to one that is None goes astray."""
    occupy_streams()
    for number, (name, mode) in enumerate(STREAMS.items()):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))


def _follow_parent() -> None:
    wait([multiprocessing.parent_process().sentinel])  # a pipe that the parent's end closes
    os._exit(1)  # at once: a run goes on from its last checkpoint


def end_when_asked() -> None:
    """Let a polite request to end (kill, a job scheduler, a closed terminal) end a run as Ctrl-C.

    A run in the background begins with Ctrl-C ignored; one under ``nohup`` outlives its terminal.
    """
    for number in REQUESTS:
        if number is signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


@contextlib.contextmanager
def postponed() -> Iterator[Callable[[], bool]]:
    """Inside the block no request to end interrupts; the function tells if one came.

    An exception in the middle of a control step would leave the world a step ahead of the
    agent. What the process ignores stays ignored. Outside the main thread, where no signal
    arrives, it is always false.

    Raises:
        KeyboardInterrupt: at the end, if one came.
    """
    came: list[int] = []
    former = {}
    if threading.current_thread() is threading.main_thread():
        heard = [n for n in REQUESTS if signal.getsignal(n) is not signal.SIG_IGN]
        former = {n: signal.signal(n, lambda number, _: came.append(number)) for n in heard}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt


def can_compile() -> bool:
    """Whether torch.compile finds a C++ compiler."""
    return any(shutil.which(name) for name in (os.environ.get("CXX", ""), "g++", "clang++") if name)


LONG = 20_000
"""Control steps from which on a run wins back the time that compiling takes."""


def pays(steps: int) -> bool:
    """Whether to compile the step of a run: it is long, and there is a C++ compiler."""
    return steps >= LONG and can_compile()


def commit() -> str | None:
    """The commit of the source tree, with a mark if files differ from it; None if installed."""
    here = Path(__file__)
    git = ["git", "-C", str(here.parent)]
    options: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 20, "check": True}
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", here.name], **options)
        describe = [*git, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        return subprocess.run(describe, **options).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None

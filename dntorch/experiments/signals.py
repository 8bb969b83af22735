"""Requests to end, heard only where a run can be saved whole."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def postponed() -> Iterator[Callable[[], bool]]:
    """Within, Ctrl-C and SIGTERM stop nothing by themselves; the function tells if one came.

    An exception in the middle of a control step would leave the world a step ahead of the
    agent. Outside the main thread, where no signal arrives, it is always false.

    Raises:
        KeyboardInterrupt: at the end, if one came.
    """
    came: list[int] = []
    former = {}
    if threading.current_thread() is threading.main_thread():
        former = {n: signal.signal(n, lambda number, _: came.append(number)) for n in SIGNALS}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt

"""Waiting in real time for what another thread or process does."""

import time

LONG = 60.0
"""s that a busy machine may take."""


def wait(condition, seconds: float = LONG) -> bool:
    """Whether it comes true in time."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()

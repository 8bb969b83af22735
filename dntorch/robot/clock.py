"""Two clocks with one face: what waits in threads in real time is an event in virtual time."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from typing import Protocol


class Ongoing(Protocol):
    """Something that goes on until it is cancelled."""

    def cancel(self) -> None: ...


class Clock(Protocol):
    """Seconds since whenever, and things that go on meanwhile."""

    real: bool
    """whether it goes on by itself, so that one may be late"""

    def now(self) -> float: ...
    def sleep_until(self, moment: float) -> None: ...
    def every(self, period: float, action: Callable[[], None]) -> Ongoing:
        """Call ``action`` every ``period`` seconds, first after one period."""

    def background(self, action: Callable[[], None]) -> Ongoing:
        """Call ``action`` over and over; it waits for data by itself, and not for ever."""


#: Goes on while the computer sleeps, where the system has such a clock: an image is as old then.
_CLOCK = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))


class RealClock:
    """The time on the wall; ``every`` and ``background`` start a thread each."""

    real = True

    def now(self) -> float:
        return time.monotonic() if _CLOCK is None else time.clock_gettime(_CLOCK)

    def sleep_until(self, moment: float) -> None:
        time.sleep(max(0.0, moment - self.now()))

    def every(self, period: float, action: Callable[[], None]) -> Ongoing:
        return _Thread(period, action)

    def background(self, action: Callable[[], None]) -> Ongoing:
        return _Thread(0.0, action)


class _Thread:
    """Calls an action over and over. One that raises is called again: who stops the robot stays.

    Attributes:
        failed: the newest error; the first of each kind is printed like any of a thread.
    """

    def __init__(self, period: float, action: Callable[[], None]) -> None:
        self._over, self.failed = threading.Event(), None
        self._thread = threading.Thread(target=self._run, args=(period, action), daemon=True)
        self._thread.start()

    def _run(self, period: float, action: Callable[[], None]) -> None:
        now = RealClock().now
        due = now() + period
        while not self._over.wait(max(0.0, due - now())):
            try:
                action()
            except Exception as error:
                self._record(error)
                self._over.wait(0.05)  # what fails at once must not take the whole processor
            due = max(due + period, now())  # who is late does not catch up in a burst

    def _record(self, error: Exception) -> None:
        known, self.failed = self.failed, error
        if type(known) is not type(error):
            threading.excepthook(
                threading.ExceptHookArgs((type(error), error, error.__traceback__, self._thread))
            )

    def cancel(self) -> None:
        self._over.set()
        if self._thread is not threading.current_thread():
            self._thread.join(5.0)


class VirtualClock:
    """Time that passes only while somebody sleeps; no threads, the same order every time.

    Events run in order of their time, then of their making. After each of them everything in
    the background gets its turn, at the same moment.

    >>> clock, seen = VirtualClock(), []
    >>> beat = clock.every(0.5, lambda: seen.append(clock.now()))
    >>> clock.sleep_until(1.5)
    >>> seen
    [0.5, 1.0, 1.5]
    """

    real = False

    def __init__(self) -> None:
        self._now, self._events, self._made = 0.0, [], itertools.count()
        self._background: list[_Event] = []

    def now(self) -> float:
        return self._now

    def sleep_until(self, moment: float) -> None:
        self._turn()
        while self._events and self._events[0][0] <= moment:
            due, _, event = heapq.heappop(self._events)
            self._now = max(self._now, due)
            if event.on:
                event.action()
                event.count += 1
                self._plan(event)
            self._turn()
        self._now = max(self._now, moment)

    def every(self, period: float, action: Callable[[], None]) -> Ongoing:
        event = _Event(action, self._now, period, next(self._made))
        self._plan(event)
        return event

    def background(self, action: Callable[[], None]) -> Ongoing:
        self._background.append(_Event(action))
        return self._background[-1]

    def _plan(self, event: "_Event") -> None:
        due = event.start + event.count * event.period  # a product: sums would drift
        heapq.heappush(self._events, (due, event.order, event))

    def _turn(self) -> None:
        self._background = [event for event in self._background if event.on]
        for event in self._background:
            if event.on:
                event.action()


class _Event:
    def __init__(
        self, action: Callable[[], None], start: float = 0.0, period: float = 0.0, order: int = 0
    ) -> None:
        self.action, self.start, self.period, self.order = action, start, period, order
        self.count, self.on = 1, True

    def cancel(self) -> None:
        self.on = False

"""Signals that end or suspend a program, and what is done first."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from dntorch.process import REQUESTS, signals

#: These end a program, too, if it does nothing else with them.
OTHERS = signals("SIGUSR1 SIGUSR2 SIGALRM SIGVTALRM SIGPROF SIGXCPU SIGIO SIGPWR")

#: Ctrl-Z; reading from a terminal or writing to it in the background.
SUSPENDING = signals("SIGTSTP SIGTTIN SIGTTOU")

#: After each suspension; after SIGSTOP, of which nobody hears before, as well.
CONTINUING = signals("SIGCONT")


class Signals:
    """Between `catch` and `release` nothing ends or suspends the program without a word.

    What the program ignores stays ignored, and what it handles it handles, after ``stop``;
    otherwise the program ends with ``SystemExit``, or is suspended.

    Args:
        stop: called first, whatever came.
        resume: called when the program goes on after it was suspended.
    """

    def __init__(self, stop: Callable[[], None], resume: Callable[[], None]) -> None:
        self._stop, self._resume = stop, resume
        self._former: dict[int, object] = {}
        self._holder: int | None = None
        self._pending: list[int] = []

    def catch(self) -> None:
        """Begin, where signals arrive: in the main thread. Elsewhere nothing happens."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number in (*REQUESTS, *OTHERS, *SUSPENDING, *CONTINUING):
            former = signal.getsignal(number)
            asked = callable(former) and number not in OTHERS  # a timer, say, is none of ours
            if asked or former is signal.SIG_DFL:
                self._former[number] = signal.signal(number, self._on_signal)

    def release(self) -> None:
        """Let the program have them as before."""
        while self._former:
            number, former = self._former.popitem()
            signal.signal(number, former)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """No signal cuts what this thread does here; those that came meanwhile act after it."""
        outer, self._holder = self._holder, threading.get_ident()
        try:
            yield
        finally:
            self._holder = outer
            while outer is None and self._pending:
                self._on_signal(self._pending.pop(0), None)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._holder == threading.get_ident():
            self._pending.append(number)  # half a command has left: the other half comes first
            return
        former = self._former.get(number)
        if number in CONTINUING:
            self._resume()
        else:
            self._stop()
        if callable(former):
            former(number, frame)
        elif number in SUSPENDING:
            os.kill(os.getpid(), signal.SIGSTOP)  # SIGCONT says when it is over
        elif number not in CONTINUING:
            raise SystemExit(128 + number)

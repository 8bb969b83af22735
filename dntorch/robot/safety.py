"""What stops the robot, whatever happens on this side of the link.

The firmware keeps the last speed for ever: it has no watchdog, and a closed connection does
not stop the motors. What no program can do from here: stop a robot whose link is down, or after
the computer has crashed or fallen asleep. So let the robot run where it can do no harm.
"""

import atexit
import contextlib
import math
import threading
from dataclasses import dataclass

from dntorch.body import EPUCK
from dntorch.quantities import Interval, check_quantities
from dntorch.robot.clock import Clock, RealClock
from dntorch.robot.contract import Frame, Robot, Watched
from dntorch.robot.signals import Signals

SLEW = Interval(0, math.inf, above=True)

#: Farthest back, in s, that a change of speed may have begun.
PAUSE = 0.1


@dataclass(frozen=True)
class Limits:
    """What is allowed.

    Raises:
        ValueError: a limit that is not positive, or a watchdog that looks too rarely.
    """

    speed: float = EPUCK.speed_cap
    """rad/s, of a wheel"""
    slew: float = 40.0
    """rad/s^2, of a wheel; infinite for none"""
    watchdog: float = 0.5
    """s without a command, or without a fresh frame, by whose end speed 0 has been sent"""
    check: float = 0.05
    """s between two looks of the watchdog"""

    def __post_init__(self) -> None:
        check_quantities(speed=self.speed, watchdog=self.watchdog, check=self.check)
        if self.slew not in SLEW:
            raise ValueError(f"slew={self.slew!r}: give a number above 0, or math.inf for none")
        if 2 * self.check > self.watchdog:
            raise ValueError(
                f"check={self.check} is too rare for watchdog={self.watchdog}: give at most half"
            )

    @property
    def patience(self) -> float:
        """s after which the watchdog must act, as it may look only ``check`` later."""
        return self.watchdog - self.check


class Guard:
    """A `Robot` that lets through only what is safe; use it in a ``with`` statement.

    ======================================  =================================================
    what happens                            what the robot gets
    ======================================  =================================================
    no fresh frame for ``watchdog`` s       a stop; then speed 0 until a frame comes
    no `drive` for ``watchdog`` s           a stop, until the next `drive`
    before the first frame, or after a      speed 0
    link was made anew
    too fast, too sudden                    the nearest speed that is allowed
    NaN or infinity                         a stop, and a ``ValueError`` for you
    the ``with`` block ends or raises       a stop, and the link is closed
    SIGINT, SIGTERM, SIGHUP, SIGQUIT        a stop; then the program goes its way to the end
    others that end a program by default    the same
    SIGTSTP (Ctrl-Z), SIGTTIN, SIGTTOU      a stop; then the program is suspended
    SIGCONT                                 speed 0 until a frame comes that is newer
    the interpreter exits                   a stop
    this process is killed, suspended, or   a stop, from another process
    its interpreter held up
    ======================================  =================================================

    A stop is speed 0, three times over. Signals and exit are watched inside ``with`` only, signals
    in the main thread. The last line is for robots that have a ``watch``, as `Driver`: see
    `dntorch.robot.deputy`.

    Attributes:
        tripped: why the robot stands although nobody said so, or ``None``.
    """

    def __init__(self, robot: Robot, clock: Clock | None = None, limits: Limits | None = None):
        self.robot, self.clock, self.limits = robot, clock or RealClock(), limits or Limits()
        self.tripped: str | None = None
        self._speeds, self._commanded = (0.0, 0.0), -math.inf
        self._lock, self._watch = threading.RLock(), None
        self._signals, self._resumed = Signals(self.stop, self._resume), -math.inf

    # ---------------------------------------------------------------- a robot

    def connect(self) -> None:
        if isinstance(self.robot, Watched):
            self.robot.watch(self.limits.watchdog)
        self.robot.connect()
        self._commanded = self.clock.now()
        if self._watch is None:
            self._watch = self.clock.every(self.limits.check, self.check)

    @property
    def frame(self) -> Frame | None:
        return self.robot.frame

    @property
    def age(self) -> float:
        return self.robot.age

    @property
    def connections(self) -> int:
        return self.robot.connections

    def drive(self, left: float, right: float) -> tuple[float, float]:
        """Drive as asked, as far as it is safe; the speeds that were sent, in rad/s.

        Raises:
            ValueError: a speed that is no finite number; the robot was stopped.
        """
        if not (math.isfinite(left) and math.isfinite(right)):
            self.stop()
            raise ValueError(f"speeds {left!r}, {right!r}: give finite rad/s; the robot stands")
        with self._whole():
            stale = self._stale()
            if stale and not self.tripped:
                self.stop()
            speeds = (0.0, 0.0) if stale else self._limited(left, right)
            self.robot.drive(*speeds)
            self.tripped, self._speeds, self._commanded = stale, speeds, self.clock.now()
        return speeds

    def stop(self) -> None:
        with self._whole():
            self._speeds = (0.0, 0.0)
            self.robot.stop()

    def close(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        with self._whole():
            self.robot.stop()
            self.robot.close()

    # ---------------------------------------------------------------- the watchdog

    def check(self) -> None:
        """Stop if frames or commands have stopped coming. The clock calls it."""
        with self._lock:
            reason = self._stale()
            if reason is None and self.clock.now() - self._commanded > self.limits.patience:
                reason = "the control loop stalled"
            if reason is not None and self.tripped is None:
                self.tripped = reason
                self.stop()

    def _stale(self) -> str | None:
        frame = self.robot.frame
        if frame is None:
            return "no frame yet"
        old = self.robot.age > self.limits.patience or frame.time <= self._resumed
        return "no fresh frame" if old else None

    def _limited(self, left: float, right: float) -> tuple[float, float]:
        """The nearest speeds that are neither too fast nor too sudden."""
        cap = self.limits.speed
        change = self.limits.slew * min(self.clock.now() - self._commanded, PAUSE)
        before = zip((left, right), self._speeds)
        first, second = (
            min(max(wanted, -cap, speed - change), cap, speed + change) for wanted, speed in before
        )
        return first, second

    # ---------------------------------------------------------------- every way out

    def __enter__(self) -> "Guard":
        self.connect()
        atexit.register(self.close)
        self._signals.catch()
        return self

    def __exit__(self, *_) -> None:
        try:
            self.close()
        finally:
            self._signals.release()
            atexit.unregister(self.close)

    def _resume(self) -> None:
        """Whatever was seen before the program was suspended says nothing of now."""
        self._resumed = self.clock.now()
        self.stop()

    @contextlib.contextmanager
    def _whole(self):
        """No other thread, and no signal, cuts what is sent here."""
        with self._lock, self._signals.held():
            yield

"""What any link may do to its reader: break, or keep bytes that nobody has read."""

import contextlib
from collections.abc import Callable, Iterator

from dntorch.robot.clock import RealClock

try:
    from termios import error as TerminalError  # an unplugged line raises it: it is no OSError
except ImportError:  # not on Windows
    TerminalError = OSError

#: Of a link that is gone, or that another thread closed meanwhile: ValueError, TypeError.
BROKEN = (OSError, TerminalError, ValueError, TypeError)


class LinkLost(ConnectionError):
    """The link to the robot is gone; the reason is in the message."""


@contextlib.contextmanager
def losing(name: str) -> Iterator[None]:
    """Whatever a broken link raises is a `LinkLost`."""
    try:
        yield
    except LinkLost:
        raise
    except BROKEN as error:
        raise LinkLost(f"the link to {name} broke: {error}") from error


class Arrivals:
    """When bytes came that are read now: after the link was last seen empty.

    Who waits for bytes on an empty link knows: now. Who finds some, or waited longer than he
    meant to, was elsewhere meanwhile (suspended, or another thread held the interpreter).

    Args:
        wait: s that ``take`` waits for bytes.
        now: a clock; real time unless you say otherwise.

    Attributes:
        behind: s since the earliest moment at which the bytes of the last `read` may have come.
    """

    SLACK = 0.02
    """s by which a wait may end late on a busy machine, and count as in time"""

    def __init__(self, wait: float, now: Callable[[], float] | None = None) -> None:
        self.wait, self.behind, self._now = wait, 0.0, now or RealClock().now
        self._empty = self._now()

    def read(self, waiting: Callable[[], bool], take: Callable[[], tuple[bytes, bool]]) -> bytes:
        """What has come.

        Args:
            waiting: whether there is something to read.
            take: waits and reads; the bytes, and whether they were all.
        """
        began = self._now()
        empty = began if not waiting() else self._empty
        data, whole = take()
        now = self._now()
        if empty == began and now - began <= self.wait + self.SLACK:
            empty = now
        self.behind = now - empty
        self._empty = now if whole else empty
        return data

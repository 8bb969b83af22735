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
    meant to, was elsewhere meanwhile (suspended, or another thread held the interpreter). That
    may happen between any two lines here, so every moment is taken before what it stands for.

    Args:
        wait: s to wait for bytes.
        now: a clock; real time unless you say otherwise.

    Attributes:
        arrived: the earliest moment at which the bytes of the last `read` may have come.
    """

    SLACK = 0.02
    """s by which a wait may end late on a busy machine, and count as in time"""

    def __init__(self, wait: float, now: Callable[[], float] | None = None) -> None:
        self.wait, self._now = wait, now or RealClock().now
        self._empty = self.arrived = self._now()

    def read(self, ready: Callable[[float], bool], take: Callable[[], tuple[bytes, bool]]) -> bytes:
        """What has come.

        Args:
            ready: whether there is something to read within so many s.
            take: the bytes, and whether they were all.
        """
        empty = began = self._now()
        if ready(0.0):
            empty = self._empty
        elif not ready(self.wait):
            self._empty = began
            return b""
        else:
            ended = self._now()
            empty = ended if ended - began <= self.wait + self.SLACK else began
        before = self._now()
        data, whole = take()
        self.arrived, self._empty = empty, before if whole else empty
        return data

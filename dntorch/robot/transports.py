"""Where bytes come from and go to: TCP or a serial line. The host's side."""

import contextlib
import os
import re
import select
import socket
import time
from typing import Protocol

from dntorch.extras import require
from dntorch.quantities import Interval
from dntorch.robot.clock import RealClock
from dntorch.robot.codecs.wifi import PORT
from dntorch.robot.link import BROKEN, Arrivals, LinkLost, TerminalError, losing


class Transport(Protocol):
    """A stream of bytes to and from a robot.

    Attributes:
        arrived: s of `RealClock`, the earliest at which the bytes of the last `receive` may have
            come; infinite for now. A reader that was held up cannot know when they came.
        descriptor: of the operating system, for another process; ``None`` if there is none.
    """

    arrived: float
    descriptor: int | None

    def open(self) -> None:
        """Connect; a transport may be opened again after it was closed."""

    def send(self, data: bytes) -> None:
        """Send all of it at once.

        Raises:
            OSError: the link is gone, or there was no room for it.
        """

    def receive(self) -> bytes:
        """What has come, after a short wait; ``b""`` when nothing came.

        Raises:
            LinkLost: the other side is gone.
        """

    def close(self) -> None:
        """Give the link back, after what was sent has left; a second call does nothing.

        Never raises: of a link that is gone there is nothing to save.
        """


PORTS = Interval(1, 65535, whole=True)
"""Of another number the system would take the last 16 bits in silence."""


class Tcp:
    """A robot on the network.

    Args:
        host, port: where it listens.
        patience: s, to wait for a connection or for room to send.
        wait: s, how long ``receive`` waits.

    Raises:
        ValueError: no such port.
    """

    def __init__(
        self, host: str, port: int = PORT, patience: float = 5.0, wait: float = 0.05
    ) -> None:
        PORTS.check("port", port)
        self.host, self.port, self.patience, self.wait = host, port, patience, wait
        self._socket: socket.socket | None = None
        self._arrivals = Arrivals(wait)

    @property
    def arrived(self) -> float:
        return self._arrivals.arrived

    @property
    def descriptor(self) -> int | None:
        return self._socket.fileno() if self._socket and os.name == "posix" else None

    def open(self) -> None:
        self.close()
        self._socket = socket.create_connection((self.host, self.port), self.patience)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._arrivals = Arrivals(self.wait)

    def send(self, data: bytes) -> None:
        self._require().sendall(data)

    def receive(self) -> bytes:
        link, size = self._require(), 1 << 16

        def ready(wait: float) -> bool:
            return bool(select.select([link], [], [], wait)[0])

        def take() -> tuple[bytes, bool]:
            data = link.recv(size)
            if not data:
                raise LinkLost(f"{self.host}:{self.port} closed the link")
            return data, len(data) < size

        with losing(f"{self.host}:{self.port}"):
            return self._arrivals.read(ready, take)

    def close(self) -> None:
        link, self._socket = self._socket, None
        if link is None:
            return
        with contextlib.suppress(OSError):
            link.shutdown(socket.SHUT_WR)  # what was sent still arrives, then the end
        with contextlib.suppress(OSError):
            link.close()

    def _require(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"no link to {self.host}:{self.port}")
        return self._socket


class Serial:
    """A robot on a serial line: Bluetooth or USB, or a pseudo-terminal.

    Args:
        path: of the device, as ``/dev/rfcomm0`` or ``COM3``.
        baud: bits/s.
        patience: s, to wait for room to send; ``wait``: s, how long ``receive`` waits.

    Raises:
        ImportError: pyserial is not installed (at ``open``).
    """

    FLUSH = 1.0
    """s that closing waits for what was sent to leave"""

    def __init__(
        self, path: str, baud: int = 115200, patience: float = 5.0, wait: float = 0.05
    ) -> None:
        self.path, self.baud, self.patience, self.wait = path, baud, patience, wait
        self._port, self._arrivals = None, Arrivals(wait)

    @property
    def arrived(self) -> float:
        return self._arrivals.arrived

    @property
    def descriptor(self) -> int | None:
        return self._port.fileno() if self._port and os.name == "posix" else None

    def open(self) -> None:
        require("serial")
        import serial

        self.close()
        try:
            self._port = serial.Serial(
                self.path, self.baud, timeout=self.wait, write_timeout=self.patience
            )
        except TerminalError as error:  # unplugged while it was opened
            raise LinkLost(f"the line {self.path} broke: {error}") from error
        self._arrivals = Arrivals(self.wait)

    def send(self, data: bytes) -> None:
        with losing(self.path):
            self._require().write(data)

    def receive(self) -> bytes:
        port, first = self._require(), b""

        def ready(wait: float) -> bool:
            nonlocal first
            if not wait:
                return port.in_waiting > 0
            first = port.read(1)  # as no select() of Windows waits for a line
            return bool(first)

        with losing(self.path):
            return self._arrivals.read(ready, lambda: (first + port.read(port.in_waiting), True))

    def close(self) -> None:
        port, self._port = self._port, None
        if port is None:
            return
        end = RealClock().now() + self.FLUSH
        with contextlib.suppress(*BROKEN):  # not flush(), which may wait for ever
            while port.out_waiting and RealClock().now() < end:
                time.sleep(0.005)
        with contextlib.suppress(*BROKEN):
            port.close()

    def _require(self):
        if self._port is None:
            raise LinkLost(f"no link to {self.path}")
        return self._port


def transport_for(address: str) -> Transport:
    """A way to the robot at ``tcp://HOST[:PORT]`` or ``serial://DEVICE``.

    Raises:
        ValueError: another kind of address.

    >>> transport_for("tcp://192.168.1.1").port
    1000
    >>> transport_for("serial:///dev/rfcomm0").path
    '/dev/rfcomm0'
    """
    kind, _, place = address.partition("://")
    if kind == "serial" and place.isprintable() and place:
        return Serial(place)
    parts = re.fullmatch(r"([^:/\s]+)(?::([0-9]{1,5}))?", place)
    if kind != "tcp" or parts is None or not is_host(parts[1]):
        raise ValueError(f"{address!r} is no robot: give tcp://HOST[:PORT] or serial://DEVICE")
    try:
        return Tcp(parts[1], int(parts[2] or PORT))
    except ValueError as error:
        raise ValueError(f"{address!r} is no robot, {error}") from error


def is_host(name: str) -> bool:
    """Whether a name server could be asked for it: ``a..b`` is none."""
    try:
        return bool(name.encode("idna"))
    except UnicodeError:
        return False

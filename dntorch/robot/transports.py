"""Where bytes come from and go to: TCP, a serial line, or memory. The host's side."""

import select
import socket
from typing import Protocol

from dntorch.robot.codecs.wifi import PORT


class LinkLost(ConnectionError):
    """The link to the robot is gone; the reason is in the message."""


class Transport(Protocol):
    """A stream of bytes to and from a robot."""

    def open(self) -> None:
        """Connect; a transport may be opened again after it was closed."""

    def send(self, data: bytes) -> None:
        """Send all of it at once."""

    def receive(self) -> bytes:
        """What has come, after a short wait; ``b""`` when nothing came.

        Raises:
            LinkLost: the other side is gone.
        """

    def close(self) -> None:
        """Give the link back, after what was sent has left; a second call does nothing."""


class Tcp:
    """A robot on the network.

    Args:
        host, port: where it listens.
        patience: s, to wait for a connection or for room to send.
        wait: s, how long ``receive`` waits.
    """

    def __init__(
        self, host: str, port: int = PORT, patience: float = 5.0, wait: float = 0.05
    ) -> None:
        self.host, self.port, self.patience, self.wait = host, port, patience, wait
        self._socket: socket.socket | None = None

    def open(self) -> None:
        self.close()
        self._socket = socket.create_connection((self.host, self.port), self.patience)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, data: bytes) -> None:
        self._require().sendall(data)

    def receive(self) -> bytes:
        link = self._require()
        try:
            if not select.select([link], [], [], self.wait)[0]:
                return b""
            data = link.recv(1 << 16)
        except (OSError, ValueError) as error:  # ValueError: closed by another thread meanwhile
            raise LinkLost(f"the link to {self.host}:{self.port} broke: {error}") from error
        if not data:
            raise LinkLost(f"{self.host}:{self.port} closed the link")
        return data

    def close(self) -> None:
        link, self._socket = self._socket, None
        if link is None:
            return
        try:
            link.shutdown(socket.SHUT_WR)  # what was sent still arrives, then the end
        except OSError:
            pass
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

    def __init__(
        self, path: str, baud: int = 115200, patience: float = 5.0, wait: float = 0.05
    ) -> None:
        self.path, self.baud, self.patience, self.wait = path, baud, patience, wait
        self._port = None

    def open(self) -> None:
        try:
            import serial
        except ImportError as error:
            raise ImportError(
                "a robot on a serial line needs pyserial: run pip install pyserial"
            ) from error
        self.close()
        self._port = serial.Serial(
            self.path, self.baud, timeout=self.wait, write_timeout=self.patience
        )

    def send(self, data: bytes) -> None:
        self._require().write(data)

    def receive(self) -> bytes:
        port = self._require()
        try:
            return port.read(max(1, port.in_waiting))
        except (OSError, TypeError) as error:  # TypeError: closed by another thread meanwhile
            raise LinkLost(f"the line {self.path} broke: {error}") from error

    def close(self) -> None:
        port, self._port = self._port, None
        if port is None:
            return
        try:
            port.flush()
        except OSError:
            pass
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
    if kind == "serial" and place:
        return Serial(place)
    host, _, port = place.partition(":")
    if kind != "tcp" or not host or not (port or "1").isdigit():
        raise ValueError(f"{address!r} is no robot: give tcp://HOST[:PORT] or serial://DEVICE")
    return Tcp(host, int(port or PORT))


class Inside:
    """The host's end of a link inside one process; the other end is a `MemoryServer`."""

    def __init__(self, server) -> None:
        self.server, self._link = server, None

    def open(self) -> None:
        self._link = self.server.connect()

    def send(self, data: bytes) -> None:
        if self._link is None or self._link.broken:
            raise LinkLost("the link in memory is broken")
        self._link.to_robot += data

    def receive(self) -> bytes:
        if self._link is None:
            raise LinkLost("no link in memory")
        data = bytes(self._link.to_host)
        self._link.to_host.clear()
        if not data and self._link.broken:
            raise LinkLost("the robot closed the link in memory")
        return data

    def close(self) -> None:
        if self._link is not None:
            self._link.ended = True
        self._link = None

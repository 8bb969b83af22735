"""The robot's end of a link, for an emulator: nothing here ever waits."""

import math
import os
import socket
from typing import Protocol

from dntorch.quantities import Interval
from dntorch.robot.link import LinkLost

CHUNK = 1 << 16
"""Bytes that are taken at a time, once a step of the world: a flood cannot hold it up."""


class Link(Protocol):
    """One client."""

    def receive(self) -> bytes | None:
        """What has come, ``b""`` for nothing, ``None`` once the client has ended its side."""

    def offer(self, data: bytes) -> int:
        """Send as much as there is room for; how many bytes that was.

        Raises:
            OSError: the link is broken.
        """

    def close(self) -> None: ...


class Server(Protocol):
    """Where clients come from."""

    address: str

    def accept(self) -> Link | None:
        """A client that has come, or ``None``."""

    def close(self) -> None: ...


PORTS = Interval(0, 65535, whole=True)


class TcpServer:
    """Listens on a port; 0 takes a free one. The ``address`` says which."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        PORTS.check("port", port)
        self._socket = socket.create_server((host, port))
        self._socket.setblocking(False)
        self.host, self.port = self._socket.getsockname()[:2]
        self.address = f"tcp://{self.host}:{self.port}"

    def accept(self) -> Link | None:
        try:
            link, _ = self._socket.accept()
        except BlockingIOError:
            return None
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return _SocketLink(link)

    def close(self) -> None:
        self._socket.close()


class _SocketLink:
    def __init__(self, link: socket.socket) -> None:
        self._socket = link

    def receive(self) -> bytes | None:
        try:
            return self._socket.recv(CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def offer(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        self._socket.close()


class PtyServer:
    """A pseudo-terminal; clients open the path in ``address``, one after the other.

    As on a serial line, nobody sees them come or go.
    """

    def __init__(self) -> None:
        import tty  # not on Windows

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.address = f"serial://{self.path}"
        self._link: _PtyLink | None = None

    def accept(self) -> Link | None:
        if self._link is not None and not self._link.closed:
            return None
        self._link = _PtyLink(self._master)
        return self._link

    def close(self) -> None:
        if self._master >= 0:
            os.close(self._master)
            os.close(self._slave)
        self._master = self._slave = -1


class _PtyLink:
    def __init__(self, master: int) -> None:
        self._master, self.closed = master, False

    def receive(self) -> bytes:
        try:
            return os.read(self._master, CHUNK)
        except BlockingIOError:
            return b""

    def offer(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        self.closed = True


class MemoryServer:
    """A server inside one process.

    Args:
        room: bytes that lie unread before ``offer`` takes no more.
    """

    address = "memory://"

    def __init__(self, room: int = 1 << 18) -> None:
        self.room, self._waiting = room, []

    def transport(self) -> "Inside":
        """The client's end."""
        return Inside(self)

    def connect(self) -> "_MemoryLink":
        link = _MemoryLink(self.room)
        self._waiting.append(link)
        return link

    def accept(self) -> Link | None:
        return self._waiting.pop(0) if self._waiting else None

    def close(self) -> None:
        for link in self._waiting:
            link.close()


class _MemoryLink:
    def __init__(self, room: int) -> None:
        self.room, self.to_host, self.to_robot = room, bytearray(), bytearray()
        self.broken = self.ended = False

    def receive(self) -> bytes | None:
        data = bytes(self.to_robot[:CHUNK])
        del self.to_robot[:CHUNK]
        return None if self.ended and not data else data

    def offer(self, data: bytes) -> int:
        if self.broken or self.ended:
            raise BrokenPipeError("nobody reads")
        taken = data[: max(0, self.room - len(self.to_host))]
        self.to_host += taken
        return len(taken)

    def close(self) -> None:
        self.broken = True


class Inside:
    """The host's end of a link inside one process; the other end is a `MemoryServer`."""

    arrived, descriptor = math.inf, None

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

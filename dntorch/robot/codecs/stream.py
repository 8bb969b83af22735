"""From pieces of a byte stream, cut anywhere, to whole packets."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

Packet = TypeVar("Packet")


class ProtocolError(ValueError):
    """Bytes that the other side never sends: the place in the stream is lost.

    No protocol here has a length or a checksum to find it again; connect anew.

    Attributes:
        packets: what was whole before the first wrong byte.
    """

    def __init__(self, message: str, packets: list[Any] | None = None) -> None:
        super().__init__(message)
        self.packets = packets or []


class Stream(Generic[Packet]):
    """Collects bytes until packets are whole.

    Args:
        split: ``bytes -> (packets, rest)``, the pure function of a protocol.

    >>> from dntorch.robot.codecs import wifi
    >>> stream = Stream(wifi.split_packets)
    >>> stream.feed(bytes([3, 2]) + bytes(100))  # an empty packet, and part of another
    [Empty()]
    >>> [type(packet).__name__ for packet in stream.feed(bytes(4))]
    ['Sensors']
    """

    def __init__(self, split: Callable[[bytes], tuple[list[Packet], bytes]]) -> None:
        self.split, self.rest = split, b""

    def feed(self, data: bytes) -> list[Packet]:
        """Packets that these bytes complete.

        Raises:
            ProtocolError: what follows is no packet. What was collected is forgotten.
        """
        buffer, self.rest = self.rest + data, b""
        packets, self.rest = self.split(buffer)
        return packets

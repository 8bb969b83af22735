"""How a host talks with each kind of robot: which bytes to say when, what the answers mean."""

from typing import NamedTuple, Protocol

from dntorch.body import EPUCK, EPUCK1_LIMIT, EPUCK2_LIMIT
from dntorch.robot.codecs import ProtocolError, Stream, sercom, sercom2, wifi
from dntorch.robot.codecs.rgb565 import Picture


class Reading(NamedTuple):
    """One image and the sensors that belong to it, as they came."""

    picture: Picture
    proximity: tuple[int, ...]
    steps: tuple[int, ...]
    """of the motors, left and right; wraps as int16"""
    time: float = 0.0
    """s, when its image had arrived"""


class Dialect(Protocol):
    """One conversation. Speeds are whole motor steps/s."""

    limit: int
    """largest speed that the motors follow"""
    watchdog: float
    """s without a frame after which the robot had better stand"""

    def hello(self) -> bytes:
        """Begin anew: speed 0, then whatever makes frames come."""

    def drive(self, left: int, right: int) -> bytes: ...
    def ask(self) -> bytes:
        """What has to be said for the next frame to come; ``b""`` while it is awaited."""

    def farewell(self) -> bytes:
        """Speed 0 and no more frames."""

    def feed(self, data: bytes, time: float = 0.0) -> list[Reading]:
        """Readings that these bytes, which arrived at ``time``, complete.

        ``b""`` says that nothing came for a moment.

        Raises:
            ProtocolError: the conversation is lost; say hello over a new link.
        """


class Wifi:
    """The e-puck2 over TCP: it streams by itself, the newest command stays in force.

    The firmware sends an image and then sensors, Webots sensors and then an image; a reading
    is complete when both are newer than those of the reading before.
    """

    limit = EPUCK2_LIMIT
    watchdog = 0.5

    def __init__(self) -> None:
        self.hello()

    def hello(self) -> bytes:
        self._stream = Stream(wifi.split_packets)
        self._picture: tuple[Picture, float] | None = None
        self._sensors: wifi.Sensors | None = None
        return self.drive(0, 0)

    def drive(self, left: int, right: int) -> bytes:
        return wifi.encode_command(wifi.Command(left, right))

    def ask(self) -> bytes:
        return b""

    def farewell(self) -> bytes:
        return wifi.encode_command(wifi.Command(request=0))

    def feed(self, data: bytes, time: float = 0.0) -> list[Reading]:
        packets = self._stream.feed(data)
        return [reading for packet in packets for reading in self._pair(packet, time)]

    def _pair(self, packet: wifi.Packet, time: float) -> list[Reading]:
        if isinstance(packet, Picture):
            self._picture = packet, time
        elif isinstance(packet, wifi.Sensors):
            self._sensors = packet
        if self._picture is None or self._sensors is None:
            return []
        (picture, seen), sensors = self._picture, self._sensors
        self._picture = self._sensors = None
        return [Reading(picture, sensors.proximity, sensors.steps, seen)]


SURPLUS = 1 << 16
"""Bytes that nobody asked for after which a robot is no robot."""

QUIET = 0.05
"""s without a byte after which a serial line is quiet"""


class Sercom:
    """The e-puck1 over a serial line: it answers what it is asked, one chain at a time.

    The first talk over Bluetooth often fails, so it asks three times for the version. The
    robot falls back to 40x40 if an image is too large for it: the true size is asked for.
    Answers that nobody asked for are thrown away. If part of one is still on its way, nothing
    is asked until the line is quiet: the rest would be taken for the next answer.

    Args:
        width, height, zoom: of the image, in pixels and sensor pixels a pixel.
    """

    limit = EPUCK1_LIMIT
    watchdog = 0.8  # an image of 52x39 is 0.35 s on its way
    asked: tuple[int, ...] = (sercom.IMAGE, sercom.PROXIMITY, sercom.GET_STEPS)
    answers = sercom.ANSWERS

    def __init__(self, width: int = EPUCK.width, height: int = EPUCK.height, zoom: int = 8) -> None:
        self.window = width, height, zoom
        self.hello()

    def hello(self) -> bytes:
        self._buffer, self._size, self._surplus, self._last = b"", (0, 0), 0, 0.0
        self._waiting = "v"
        """letter of the line that is awaited, ``frame``, ``quiet``, or nothing"""
        self._next = "j"
        return self.drive(0, 0) + 3 * sercom.text("V")

    def drive(self, left: int, right: int) -> bytes:
        return sercom.chain(sercom.set_speed(left, right))

    def ask(self) -> bytes:
        if self._waiting:
            return b""
        self._waiting = self._next
        if self._next == "j":
            # Again speed 0: if the first talk failed, this is the first that is heard.
            return self.drive(0, 0) + sercom.text("J", 1, *self.window, -1, -1)
        if self._next == "frame":
            return sercom.chain(*self.asked)
        return sercom.text(self._next.upper())

    def farewell(self) -> bytes:
        return self.drive(0, 0) + sercom.text("S")

    def feed(self, data: bytes, time: float = 0.0) -> list[Reading]:
        if self._waiting == "quiet":
            return self._calm(len(data), time)
        self._buffer += data
        if self._waiting == "frame":
            return self._frame(time)
        lines, self._buffer = sercom.split_lines(self._buffer)
        while lines and self._waiting:
            self._line(lines.pop(0))
        if self._next == "frame" and not self._waiting:
            self._discard(len(self._buffer) + sum(map(len, lines)), time)
        return []

    def _line(self, line: str) -> None:
        """Lines that nobody waits for, as a welcome, are passed over."""
        if line[0].lower() != self._waiting:
            return
        if self._waiting == "i":
            _, numbers = sercom.read_line(line)
            if len(numbers) < 3:
                raise ProtocolError(f"{line!r} does not say the size of images")
            self._size = numbers[1:3]
        elif self._waiting == "m":
            self.answers = sercom.answers_of(line, self.answers)
        ground = sercom.GROUND in self.asked
        follows = {"v": "j", "j": "i", "i": "m" if ground else "frame", "m": "frame"}
        self._next, self._waiting = follows[self._waiting], ""

    def _frame(self, time: float) -> list[Reading]:
        size = tuple(self._buffer[1:3])
        if len(size) == 2 and size != self._size:
            raise ProtocolError(f"an image of {size} came, {self._size} was agreed")
        found, rest = sercom.read_answers(self.asked, self._buffer, self.answers)
        if found is None:
            return []
        self._waiting = ""
        whole = len(self._buffer) - len(rest)
        self._discard(len(rest) if len(rest) % whole else 0, time)
        return [Reading(found[sercom.IMAGE], *self._sensed(found), time)]

    def _discard(self, surplus: int, time: float) -> None:
        """Empty the buffer; wait for quiet if a ``surplus`` of bytes begins something."""
        self._buffer, self._surplus, self._last = b"", surplus, time
        if surplus:
            self._waiting = "quiet"

    def _calm(self, came: int, time: float) -> list[Reading]:
        self._surplus += came
        self._last = time if came else self._last
        if self._surplus > SURPLUS:
            raise ProtocolError(f"{self._surplus} bytes came that nobody asked for")
        self._waiting = "quiet" if time - self._last < QUIET else ""
        return []

    def _sensed(self, found: dict) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return found[sercom.PROXIMITY], found[sercom.GET_STEPS]


class Sercom2(Sercom):
    """The e-puck2 over a serial line: as `Sercom`, but all sensors come in one answer."""

    limit = EPUCK2_LIMIT
    asked = (sercom.IMAGE, sercom2.ALL_SENSORS)
    answers = sercom2.ANSWERS

    def _sensed(self, found: dict) -> tuple[tuple[int, ...], tuple[int, ...]]:
        sensors = sercom2.decode_sensors(found[sercom2.ALL_SENSORS][0])
        return sensors.proximity, sensors.steps


DIALECTS = {"wifi": Wifi, "sercom": Sercom, "sercom2": Sercom2}

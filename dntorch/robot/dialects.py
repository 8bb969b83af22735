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

    def feed(self, data: bytes) -> list[Reading]:
        """Readings that these bytes complete.

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
        self._picture: Picture | None = None
        self._sensors: wifi.Sensors | None = None
        return self.drive(0, 0)

    def drive(self, left: int, right: int) -> bytes:
        return wifi.encode_command(wifi.Command(left, right))

    def ask(self) -> bytes:
        return b""

    def farewell(self) -> bytes:
        return wifi.encode_command(wifi.Command(request=0))

    def feed(self, data: bytes) -> list[Reading]:
        return [reading for packet in self._stream.feed(data) for reading in self._pair(packet)]

    def _pair(self, packet: wifi.Packet) -> list[Reading]:
        if isinstance(packet, Picture):
            self._picture = packet
        elif isinstance(packet, wifi.Sensors):
            self._sensors = packet
        if self._picture is None or self._sensors is None:
            return []
        reading = Reading(self._picture, self._sensors.proximity, self._sensors.steps)
        self._picture = self._sensors = None
        return [reading]


class Sercom:
    """The e-puck1 over a serial line: it answers what it is asked, one chain at a time.

    The first talk over Bluetooth often fails, so it asks three times for the version. The
    robot falls back to 40x40 if an image is too large for it: the true size is asked for.

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
        self._buffer, self._size = b"", (0, 0)
        self._waiting = "v"
        """letter of the line that is awaited, ``frame``, or nothing"""
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
        return sercom.text("I") if self._next == "i" else sercom.chain(*self.asked)

    def farewell(self) -> bytes:
        return self.drive(0, 0) + sercom.text("S")

    def feed(self, data: bytes) -> list[Reading]:
        self._buffer += data
        if self._waiting == "frame":
            return self._frame()
        lines, self._buffer = sercom.split_lines(self._buffer)
        for line in lines:
            self._line(line)
        return []

    def _line(self, line: str) -> None:
        """Lines that nobody waits for, as a welcome, are passed over."""
        if not self._waiting or line[0].lower() != self._waiting:
            return
        if self._waiting == "i":
            _, numbers = sercom.read_line(line)
            if len(numbers) < 3:
                raise ProtocolError(f"{line!r} does not say the size of images")
            self._size = numbers[1:3]
        self._next = {"v": "j", "j": "i", "i": "frame"}[self._waiting]
        self._waiting = ""

    def _frame(self) -> list[Reading]:
        found, self._buffer = sercom.read_answers(self.asked, self._buffer, self.answers)
        if found is None:
            return []
        self._waiting = ""
        picture = found[sercom.IMAGE]
        if (picture.width, picture.height) != self._size:
            raise ProtocolError(f"an image of {picture[:2]} came, {self._size} was agreed")
        return [Reading(picture, *self._sensed(found))]

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

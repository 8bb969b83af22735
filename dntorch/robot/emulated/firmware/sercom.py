"""The robot's side of SerCom: it answers what it is asked, in turn.

Sources: ``Asercom.c`` of GCtronic's e-puck-library (DemoGCtronic-complete), ``Asercom2.c`` of
the e-puck2's main processor.
"""

from collections import deque

import numpy as np

from dntorch.body import EPUCK1_LIMIT, EPUCK2_LIMIT
from dntorch.robot.codecs import Stream, rgb565, sercom, sercom2, wifi
from dntorch.robot.emulated.firmware.base import Feel, Look, clip
from dntorch.robot.images import resample


class SercomFirmware:
    """An e-puck1, or with ``version=2`` an e-puck2, over a serial line: it answers in turn.

    Args:
        version: 1 or 2.
        room: bytes of the largest image; larger ones become 40x40 in silence.
        ground: places of the ground that it measures: 3, or 5 if built with cliff sensors.

    What it is told it does at once. Of requests beyond `QUEUE` that wait for their turn to be
    answered the newest are not, as when the robot's buffer runs over.
    """

    QUEUE = 64

    def __init__(self, version: int = 1, room: int = 52 * 39 * 2, ground: int = 3) -> None:
        self.limit = EPUCK1_LIMIT if version == 1 else EPUCK2_LIMIT
        self.version, self.room, self.ground = version, room, ground
        self.speeds, self.counters, self.calibrations = (0, 0), None, 0
        self.camera = (1, 40, 40, 8)
        """mode, width, height, zoom"""
        arguments = sercom.ARGUMENTS if version == 1 else sercom2.ARGUMENTS
        self._stream = Stream(lambda data: sercom.split_requests(data, arguments))
        self._waiting: deque[sercom.Request] = deque()

    def take(self, data: bytes) -> None:
        try:
            requests = self._stream.feed(data)
        except sercom.ProtocolError as error:  # the robot's buffer runs over and is empty again
            requests = error.packets
        for request in requests:
            self._obey(request)
            if len(self._waiting) < self.QUEUE:
                self._waiting.append(request)

    def greet(self) -> None:
        self._stream.rest, self._waiting = b"", deque()

    def farewell(self) -> bool:
        return True

    def _obey(self, request: sercom.Request) -> None:
        if isinstance(request, sercom.Text):
            letter, numbers = request.letter.upper(), request.arguments
            if letter == "D":
                self._move((*numbers, 0, 0)[:2])
            elif letter == "S":
                self._move((0, 0))
            elif letter == "P":
                self.counters = (*numbers, 0, 0)[:2]
            elif letter == "J":
                self._window((*numbers, 0, 0, 0, 0)[:4])
            self.calibrations += letter == "K"
            return
        for code, data in request:
            self._obey_code(code, data)

    def _obey_code(self, code: int, data: bytes) -> None:
        if code in (sercom.SET_SPEED, sercom.SET_STEPS):
            pair = tuple(np.frombuffer(data, "<i2").tolist())
            if code == sercom.SET_SPEED:
                self._move(pair)
            else:
                self.counters = pair
        elif code == sercom2.ACTUATORS and self.version == 2:
            command = sercom2.read_actuators(data)
            self.calibrations += bool(command.settings & wifi.CALIBRATE)
            if command.settings & wifi.SET_STEPS:
                self.counters = command[:2]
            else:
                self._move(command[:2])

    def _move(self, speeds: tuple[int, int]) -> None:
        self.speeds = clip(speeds, self.limit)

    def _window(self, camera: tuple[int, int, int, int]) -> None:
        mode, width, height, _ = camera
        fits = 0 < width < 128 and 0 < height < 128 and mode in (0, 1)
        fits = fits and (1 + mode) * width * height <= self.room
        self.camera = camera if fits else (1, 40, 40, 8)

    def give(self, look: Look, feel: Feel) -> list[bytes]:
        packets = []
        while self._waiting:
            answer = self._answer(self._waiting[0], look, feel)
            if answer is None:
                break
            packets += [answer] if answer else []
            self._waiting.popleft()
        return packets

    def _answer(self, request, look: Look, feel: Feel) -> bytes | None:
        if isinstance(request, sercom.Text):
            return self._text(request.letter, feel()).encode() + b"\r\n"
        image = None
        if any(code == sercom.IMAGE for code, _ in request):
            image = look()
            if image is None:
                return None
        sensors = feel()
        return b"".join(self._code(code, image, sensors) for code, _ in request)

    def _text(self, letter: str, sensors: wifi.Sensors) -> str:
        mode, width, height, zoom = self.camera
        version = "1.2.2" if self.version == 1 else "2.0"
        values = {
            "E": self.speeds, "N": sensors.proximity, "O": sensors.ambient, "Q": sensors.steps,
            "I": (mode, width, height, zoom, (1 + mode) * width * height),
            "A": sensors.accelerometer, "C": (sensors.selector,), "M": self._below(sensors),
            "U": sensors.microphones[:3],
            "V": (f"Version {version} (emulated)\r\nHW version: 0",),
        }  # fmt: skip
        name = letter.upper()
        if name in values:
            return ",".join([name.lower(), *map(str, values[name])])
        known = len(name) == 1 and name in "BDFGHJKLPRST"
        return name.lower() if known else "z,Command not found"

    def _code(self, code: int, image: np.ndarray | None, sensors: wifi.Sensors) -> bytes:
        if code == sercom.IMAGE:
            return self._picture(image)
        if code == sercom2.ALL_SENSORS and self.version == 2:
            return sercom2.encode_sensors(sensors)
        values = {
            sercom.GET_SPEED: ("<i2", self.speeds), sercom.GET_STEPS: ("<i2", sensors.steps),
            sercom.PROXIMITY: ("<u2", sensors.proximity), sercom.AMBIENT: ("<u2", sensors.ambient),
            sercom.ACCELEROMETER: ("<i2", sensors.accelerometer),
            sercom.GYROSCOPE: ("<i2", sensors.gyroscope),
            sercom.GROUND: ("<u2", self._below(sensors)),
            sercom.MICROPHONES: ("<u2", sensors.microphones[:3]),
            sercom.INCLINATION: ("<f4", sensors[1:4]),
            sercom.BATTERY: ("<u2", (sensors.battery,)),
            sercom.TEMPERATURE: ("<i1", (sensors.temperature,)),
        }  # fmt: skip
        kind, numbers = values.get(code, ("<u1", ()))
        return np.array(numbers, kind).tobytes()

    def _below(self, sensors: wifi.Sensors) -> tuple[int, ...]:
        """The cliff sensors see what those of the ground see."""
        return (2 * sensors.ground)[: self.ground]

    def _picture(self, image: np.ndarray) -> bytes:
        mode, width, height, _ = self.camera
        small = resample(image, width, height)
        gray = small.mean(-1).astype(np.uint8).tobytes()
        pixels = rgb565.encode(small) if mode else gray
        return bytes([mode, width, height]) + pixels

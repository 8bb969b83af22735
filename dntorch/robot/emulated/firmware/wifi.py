"""The robot's side of the Wi-Fi protocol.

Sources: ``socket_e-puck2.c`` of the e-puck2's ESP32, ``e-puck2_server.c`` of Webots.
"""

from dntorch.body import EPUCK2_LIMIT
from dntorch.robot.codecs import rgb565, wifi
from dntorch.robot.emulated.firmware.base import Feel, Look, clip
from dntorch.robot.images import resample

PACINGS = ("firmware", "webots", "request")


class WifiFirmware:
    """An e-puck2 over Wi-Fi.

    ============ ====================================================================
    ``pacing``
    ============ ====================================================================
    ``firmware`` streams from the first command on, an image and then sensors; drops
                 all but the last of five or more commands that lie unread
    ``webots``   streams sensors and then an image; one command a step, one that
                 arrives in pieces is lost; stops when the host has gone
    ``request``  one image and sensors for each step with a command; the ideal robot
    ============ ====================================================================
    """

    limit = EPUCK2_LIMIT

    def __init__(self, pacing: str = "firmware") -> None:
        if pacing not in PACINGS:
            raise ValueError(f"pacing={pacing!r} is unknown: choose from {PACINGS}")
        self.pacing, self.speeds, self.counters = pacing, (0, 0), None
        self.calibrations, self._buffer, self._request = 0, b"", None

    def take(self, data: bytes) -> None:
        self._buffer += data
        if self.pacing == "webots":
            command, self._buffer = self._buffer[:21], self._buffer[21:]
            self._obey(command)
            return
        whole = len(self._buffer) // 21 * 21
        commands = [self._buffer[at : at + 21] for at in range(0, whole, 21)]
        self._buffer = self._buffer[whole:]
        for command in commands[-1:] if len(commands) >= 5 else commands:
            self._obey(command)

    def _obey(self, data: bytes) -> None:
        if len(data) != 21 or data[0] != wifi.COMMAND:
            return
        command = wifi.decode_command(data)
        self._request = command.request
        self.calibrations += bool(command.settings & wifi.CALIBRATE)
        if command.settings & wifi.SET_STEPS:
            self.counters = command[:2]
        else:
            self.speeds = clip(command[:2], self.limit)

    def give(self, look: Look, feel: Feel) -> list[bytes]:
        request = self._request
        if request is None:
            return []
        image = look() if request & wifi.ASK_IMAGE else None
        if request & wifi.ASK_IMAGE and image is None:
            return []
        packets = [b"\1" + rgb565.encode(resample(image, 160, 120))] if image is not None else []
        packets += [wifi.encode_packet(feel())] if request & wifi.ASK_SENSORS else []
        if self.pacing == "request":
            self._request = None
        if self.pacing == "webots":
            return packets[::-1]
        return packets or [wifi.encode_packet(wifi.Empty())]

    def greet(self) -> None:
        self._buffer, self._request = b"", None

    def farewell(self) -> bool:
        if self.pacing == "webots":
            self.speeds, self._request = (0, 0), None
        # The real one only sees that nothing more can be sent.
        return self.pacing != "firmware" or self._request is None

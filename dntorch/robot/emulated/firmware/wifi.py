"""The robot's side of the Wi-Fi protocol.

Sources: ``socket_e-puck2.c`` of the e-puck2's ESP32, ``e-puck2_server.c`` of Webots.
"""

from dntorch.body import EPUCK2_LIMIT
from dntorch.robot.codecs import rgb565, wifi
from dntorch.robot.emulated.firmware.base import Feel, Look, clip
from dntorch.robot.images import resample

PACINGS = ("firmware", "webots", "request")
SIZE = 21
"""Bytes of a command."""
UNREAD = 4000 * SIZE
"""Bytes that wait to be read at most, more than come in a step; what is beyond is lost."""


class WifiFirmware:
    """An e-puck2 over Wi-Fi.

    ============ ====================================================================
    ``pacing``
    ============ ====================================================================
    ``firmware`` streams from the first command on, an image and then sensors; of 105
                 and more bytes that lie unread it drops all but the last command,
                 also that one if another has begun
    ``webots``   streams sensors and then an image; one command a step, one that
                 arrives in pieces is lost; stops when the host has gone
    ``request``  one image and sensors for each step with a command; the ideal robot
    ============ ====================================================================

    **After a stray byte** none finds the beginning of a command again by itself. The firmware
    counts off 21 bytes, asks for the first 80 in the first command of a host alone, and obeys
    what comes after as it lies, here shifted by a byte: of speeds (l, r) the left wheel then gets
    the settings and the low byte of l, the right one the high byte of l and the low byte of r.
    Speed 0 without settings is then still speed 0. After three to six stray bytes it is not: the
    80 with which a command begins lies in a speed. A part of a command holds its stream up
    until the rest has come. The ideal robot obeys likewise; that of Webots drops what is no
    command, and what came alone in a step does not shift what follows.
    """

    limit = EPUCK2_LIMIT

    def __init__(self, pacing: str = "firmware") -> None:
        if pacing not in PACINGS:
            raise ValueError(f"pacing={pacing!r} is unknown: choose from {PACINGS}")
        self.pacing, self.speeds, self.counters = pacing, (0, 0), None
        self.calibrations, self._buffer, self._request = 0, b"", None
        self._commanded = False

    def take(self, data: bytes) -> None:
        buffer = (self._buffer + data)[:UNREAD]
        if self.pacing == "webots":
            command, self._buffer = buffer[:SIZE], buffer[SIZE:]
            if len(command) == SIZE and command[0] == wifi.COMMAND:
                self._obey(command)
            return
        whole = len(buffer) // SIZE * SIZE
        commands = [buffer[at : at + SIZE] for at in range(0, whole, SIZE)]
        self._buffer = buffer[whole:]
        if len(commands) >= 5:
            commands = [] if self._buffer else commands[-1:]
        for command in commands:
            if command[0] == wifi.COMMAND or self._commanded:
                self._commanded = True
                self._obey(command)

    def _obey(self, data: bytes) -> None:
        command = wifi.decode_command(bytes([wifi.COMMAND]) + data[1:])
        self._request = command.request
        self.calibrations += bool(command.settings & wifi.CALIBRATE)
        if command.settings & wifi.SET_STEPS:
            self.counters = command[:2]
        else:
            self.speeds = clip(command[:2], self.limit)

    def give(self, look: Look, feel: Feel) -> list[bytes]:
        request = self._request
        if request is None or (self._buffer and self.pacing == "firmware"):
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
        return packets if request else [wifi.encode_packet(wifi.Empty())]

    def greet(self) -> None:
        self._buffer, self._request, self._commanded = b"", None, False

    def farewell(self) -> bool:
        if self.pacing == "webots":
            self.speeds, self._request = (0, 0), None
        self._buffer = b""
        # The real one only sees that nothing more can be sent. If it sends nothing, since a
        # shifted command asks for nothing that there is, it never takes another client: here it
        # does.
        asked = (self._request or 0) & (wifi.ASK_IMAGE | wifi.ASK_SENSORS)
        return self.pacing != "firmware" or not (asked or self._request == 0)

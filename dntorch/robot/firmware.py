"""The robot's side of each conversation, as its firmware leads it. It never stops by itself.

Sources: ``socket_e-puck2.c`` of the e-puck2's ESP32, ``e-puck2_server.c`` of Webots.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from dntorch.robot.codecs import rgb565, wifi
from dntorch.robot.images import resample

PACINGS = ("firmware", "webots", "request")

Look = Callable[[], np.ndarray | None]
"""Takes the next image, RGB; ``None`` while the camera has no new one."""

Feel = Callable[[], wifi.Sensors]
"""Reads the sensors."""


class Firmware(Protocol):
    """One robot's program."""

    speeds: tuple[int, int]
    """motor steps/s that are in force"""
    counters: tuple[int, int] | None
    """what the host wants the step counters to show from now on"""
    calibrations: int
    """how often the host asked to calibrate the infra-red sensors"""

    def take(self, data: bytes) -> None:
        """What the host said."""

    def give(self, look: Look, feel: Feel) -> list[bytes]:
        """Packets that are sent now."""

    def greet(self) -> None:
        """A host has come. The last speed stays in force."""

    def farewell(self) -> bool:
        """The host has gone; whether the robot takes notice and ends the link."""


def clip(speeds: tuple[int, int], limit: int) -> tuple[int, int]:
    left, right = (min(max(speed, -limit), limit) for speed in speeds)
    return left, right


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

    limit = 1100

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


def build_firmware(protocol: str, pacing: str = "firmware") -> Firmware:
    """The program of a robot: ``wifi``, ``sercom`` or ``sercom2``."""
    if protocol == "wifi":
        return WifiFirmware(pacing)
    if protocol not in ("sercom", "sercom2"):
        raise ValueError(f"protocol={protocol!r} is unknown: choose wifi, sercom or sercom2")
    if pacing == "webots":
        raise ValueError(f"pacing={pacing!r} is of wifi alone: {protocol} answers in turn")
    from dntorch.robot.firmware_sercom import SercomFirmware  # which builds on this file

    return SercomFirmware(2 if protocol == "sercom2" else 1)

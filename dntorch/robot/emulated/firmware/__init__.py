"""The robot's side of each conversation, as its firmware leads it. It never stops by itself."""

from dntorch.robot.emulated.firmware.base import Firmware
from dntorch.robot.emulated.firmware.sercom import SercomFirmware
from dntorch.robot.emulated.firmware.wifi import WifiFirmware

__all__ = ["Firmware", "SercomFirmware", "WifiFirmware", "build_firmware"]


def build_firmware(protocol: str, pacing: str = "firmware") -> Firmware:
    """The program of a robot: ``wifi``, ``sercom`` or ``sercom2``."""
    if protocol == "wifi":
        return WifiFirmware(pacing)
    if protocol not in ("sercom", "sercom2"):
        raise ValueError(f"protocol={protocol!r} is unknown: choose wifi, sercom or sercom2")
    if pacing == "webots":
        raise ValueError(f"pacing={pacing!r} is of wifi alone: {protocol} answers in turn")
    return SercomFirmware(2 if protocol == "sercom2" else 1)

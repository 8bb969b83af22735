"""The e-puck2 over Wi-Fi: TCP port 1000, the robot listens, one client.

Sources: ``socket_e-puck2.c`` and ``uart_e-puck2.c`` of the ESP32 firmware and ``Asercom2.c``
of the main processor (repositories e-puck2/e-puck2_esp32 and e-puck2/e-puck2_main-processor),
``EPuckCommandPacket.cpp`` and ``e-puck2_server.c`` of Webots.

To the robot go commands of 21 bytes. From it comes one identifier byte and a payload:
``01`` an image, ``02`` the sensors, ``03`` nothing. The order of the packets differs between
robots and simulators; there is no length, number or checksum.
"""

import struct
from typing import NamedTuple

from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.codecs.stream import ProtocolError

PORT = 1000
WIDTH, HEIGHT = 160, 120

COMMAND, IMAGE, SENSORS, EMPTY = 0x80, 0x01, 0x02, 0x03
ASK_IMAGE, ASK_SENSORS = 0x01, 0x02  # request
CALIBRATE, AVOID, SET_STEPS = 0x01, 0x02, 0x04  # settings

_COMMAND = struct.Struct("<BBBhhB12sB")
_SENSORS = struct.Struct("<3h3f3h3fb8H8HH4H2hHBBBBB3H3HBB")
_SIZES = {IMAGE: 2 * WIDTH * HEIGHT, SENSORS: _SENSORS.size, EMPTY: 0}


class Command(NamedTuple):
    """What the host wants; the robot keeps it in force until the next command."""

    left: int = 0
    """motor steps/s"""
    right: int = 0
    request: int = ASK_IMAGE | ASK_SENSORS
    """what the robot shall send from now on"""
    settings: int = 0
    """``CALIBRATE`` the infra-red sensors once, ``AVOID`` obstacles, ``SET_STEPS`` counters"""
    leds: int = 0
    """bits of LED 1, 3, 5, 7, body, front"""
    rgb: bytes = bytes(12)
    """red, green, blue of LED 2, 4, 6, 8: 0 to 100; above leaves it as it is"""
    sound: int = 0


class Sensors(NamedTuple):
    """All that the e-puck2 measures, in the order of its 104 bytes."""

    accelerometer: tuple[int, ...] = (0,) * 3
    acceleration: float = 0.0
    orientation: float = 0.0
    """degrees"""
    inclination: float = 0.0
    """degrees"""
    gyroscope: tuple[int, ...] = (0,) * 3
    magnetometer: tuple[float, ...] = (0.0,) * 3
    """microtesla"""
    temperature: int = 0
    """degrees Celsius"""
    proximity: tuple[int, ...] = (0,) * 8
    """ps0 ... ps7, clockwise from the front right"""
    ambient: tuple[int, ...] = (0,) * 8
    """0 is bright, about 4000 dark"""
    distance: int = 0
    """mm, of the time-of-flight sensor"""
    microphones: tuple[int, ...] = (0,) * 4
    """right, left, back, front"""
    steps: tuple[int, ...] = (0,) * 2
    """of the motors, left and right, 1000 a turn; wraps as int16"""
    battery: int = 0
    card: int = 0
    remote: tuple[int, ...] = (0,) * 3
    """toggle, address and data of a television's remote control"""
    selector: int = 0
    ground: tuple[int, ...] = (0,) * 3
    ground_ambient: tuple[int, ...] = (0,) * 3
    button: int = 0
    reserved: int = 0


class Empty(NamedTuple):
    """The robot was asked for nothing."""


Packet = Picture | Sensors | Empty


def encode_command(command: Command) -> bytes:
    """The 21 bytes of a command.

    Raises:
        ValueError: a number that does not fit its field.

    >>> encode_command(Command(100, -100))[:8].hex(" ")
    '80 03 00 64 00 9c ff 00'
    """
    left, right, request, *others = command
    settings, leds, rgb, sound = others
    if len(rgb) != 12:
        raise ValueError(f"rgb={rgb!r}: give 12 bytes, three for each of four LEDs")
    try:
        return _COMMAND.pack(COMMAND, request, settings, left, right, leds, rgb, sound)
    except struct.error as error:
        raise ValueError(f"{command} does not fit into 21 bytes: {error}") from error


def decode_command(data: bytes) -> Command:
    """A command from its 21 bytes.

    Raises:
        ProtocolError: another number of bytes or another first byte than 80.
    """
    if len(data) != _COMMAND.size or data[0] != COMMAND:
        raise ProtocolError(f"{data[:24].hex(' ')} is no command: 21 bytes that begin with 80")
    _, request, settings, left, right, leds, rgb, sound = _COMMAND.unpack(data)
    return Command(left, right, request, settings, leds, rgb, sound)


def split_commands(buffer: bytes) -> tuple[list[Command], bytes]:
    """Commands at the front of a stream to the robot, and the bytes after them.

    Raises:
        ProtocolError: something else than a command begins.
    """
    commands, at = [], 0
    while at < len(buffer):
        if buffer[at] != COMMAND:
            raise ProtocolError(f"byte {buffer[at]:02x} begins no command", commands)
        if at + _COMMAND.size > len(buffer):
            break
        commands.append(decode_command(buffer[at : at + _COMMAND.size]))
        at += _COMMAND.size
    return commands, buffer[at:]


def encode_sensors(sensors: Sensors) -> bytes:
    """The 104 bytes of the sensors, without identifier."""
    flat = []
    for value in sensors:
        flat.extend(value if isinstance(value, tuple) else (value,))
    try:
        return _SENSORS.pack(*flat)
    except struct.error as error:
        raise ValueError(f"{sensors} does not fit into 104 bytes: {error}") from error


def decode_sensors(data: bytes) -> Sensors:
    """Sensors from their 104 bytes.

    Raises:
        ProtocolError: another number of bytes.
    """
    if len(data) != _SENSORS.size:
        raise ProtocolError(f"{len(data)} bytes of sensors: 104 were expected")
    flat, parts = iter(_SENSORS.unpack(data)), []
    for blank in Sensors():
        tuples = isinstance(blank, tuple)
        parts.append(tuple(next(flat) for _ in blank) if tuples else next(flat))
    return Sensors(*parts)


def encode_packet(packet: Packet) -> bytes:
    """Identifier and payload, as the robot sends them."""
    if isinstance(packet, Picture):
        if len(packet.pixels) != _SIZES[IMAGE]:
            raise ValueError(f"{len(packet.pixels)} bytes of image: {_SIZES[IMAGE]} are sent")
        return bytes([IMAGE]) + packet.pixels
    if isinstance(packet, Sensors):
        return bytes([SENSORS]) + encode_sensors(packet)
    return bytes([EMPTY])


def split_packets(buffer: bytes) -> tuple[list[Packet], bytes]:
    """Packets at the front of a stream from the robot, and the bytes after them.

    Raises:
        ProtocolError: a byte that identifies no packet.
    """
    packets, at = [], 0
    while at < len(buffer):
        kind = buffer[at]
        if kind not in _SIZES:
            raise ProtocolError(f"byte {kind:02x} begins no packet", packets)
        end = at + 1 + _SIZES[kind]
        if end > len(buffer):
            break
        packets.append(_decode(kind, buffer[at + 1 : end]))
        at = end
    return packets, buffer[at:]


def _decode(kind: int, payload: bytes) -> Packet:
    if kind == IMAGE:
        return Picture(WIDTH, HEIGHT, payload)
    return decode_sensors(payload) if kind == SENSORS else Empty()

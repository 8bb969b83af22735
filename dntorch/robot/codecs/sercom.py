"""SerCom, what an e-puck1 speaks over Bluetooth's serial line: 115200 baud, 8N1.

Sources: ``Asercom.c`` of GCtronic's e-puck-library (DemoGCtronic-complete) and of the
e-puck2's main processor; the Bluetooth plugin of Webots.

Two languages on one line. **Text**: a letter and arguments, ended by a carriage return or a
line feed; the answer is a line that begins with the small letter. **Binary**: bytes with the
top bit set, each followed by its arguments, chained and ended by 00; only then come all
answers, one after the other, without any frame. So the host must know what it asked for.
Integers are little-endian, the pixels of images are not.
"""

import re
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.codecs.stream import ProtocolError

SET_SPEED, GET_SPEED, SET_STEPS, GET_STEPS = 0xBC, 0xBB, 0xB0, 0xAF
PROXIMITY, AMBIENT, GROUND, MICROPHONES = 0xB2, 0xB1, 0xB3, 0x8B
ACCELEROMETER, INCLINATION, GYROSCOPE = 0x9F, 0xBF, 0x99
BATTERY, TEMPERATURE, LED, I2C, IMAGE = 0x9E, 0x8C, 0xB4, 0xA9, 0xB7

#: Bytes of arguments that follow a code; 0 where it is not named.
ARGUMENTS = {SET_SPEED: 4, SET_STEPS: 4, LED: 2, I2C: 3}

#: What a code answers, as a format of ``struct``; an image has a header of its own. ``GROUND``
#: depends on the robot: `answers_of`.
ANSWERS = {
    GET_SPEED: "<2h", GET_STEPS: "<2h", PROXIMITY: "<8H", AMBIENT: "<8H", GROUND: "<3H",
    MICROPHONES: "<3H", ACCELEROMETER: "<3h", INCLINATION: "<3f", GYROSCOPE: "<3h",
    BATTERY: "<H", TEMPERATURE: "<b", IMAGE: "",
}  # fmt: skip

LONGEST = 256
"""Bytes of the longest line of text; more without an end is no text."""


class Text(NamedTuple):
    """One command of text, as the robot reads it."""

    letter: str
    arguments: tuple[int, ...] = ()


class Code(NamedTuple):
    """One binary command, as the robot reads it."""

    code: int
    arguments: bytes = b""


Request = Text | tuple[Code, ...]


def text(letter: str, *arguments: int) -> bytes:
    """A command of text.

    >>> text("D", 100, -100)
    b'D,100,-100\\n'
    """
    return ",".join([letter, *map(str, arguments)]).encode() + b"\n"


def chain(*parts: int | bytes) -> bytes:
    """Binary commands that are answered together: codes, or bytes of code and arguments.

    >>> chain(set_speed(100, -100), PROXIMITY).hex(" ")
    'bc 64 00 9c ff b2 00'
    """
    return b"".join(bytes([p]) if isinstance(p, int) else p for p in parts) + b"\0"


def set_speed(left: int, right: int) -> bytes:
    """Code and arguments of a speed in motor steps/s."""
    return struct.pack("<Bhh", SET_SPEED, left, right)


# ---------------------------------------------------------------- what the host reads


def split_lines(buffer: bytes) -> tuple[list[str], bytes]:
    """Lines of text without their ends, CR LF; empty ones are left out.

    Raises:
        ProtocolError: far too many bytes without an end.
    """
    *whole, rest = buffer.split(b"\n")
    lines = [line.decode("latin-1").strip("\r\f\a") for line in whole]
    if len(rest) > LONGEST:
        raise ProtocolError(f"{len(rest)} bytes without an end of line", [x for x in lines if x])
    return [line for line in lines if line], rest


def read_line(line: str) -> tuple[str, tuple[int, ...]]:
    """Letter and numbers of an answer.

    Raises:
        ProtocolError: something between the commas is no whole number.

    >>> read_line("e,10,-5")
    ('e', (10, -5))
    """
    letter, *numbers = line.split(",")
    try:
        return letter, tuple(int(number) for number in numbers)
    except ValueError as error:
        raise ProtocolError(f"{line[:40]!r} is no answer of numbers") from error


def answers_of(line: str, answers: Mapping[int, str] = ANSWERS) -> dict[int, str]:
    """Formats of one robot's answers, from its answer to the text ``M``.

    An e-puck1 whose firmware was built with cliff sensors measures the ground in 5 places
    instead of 3, and nothing in the binary answer tells.

    Raises:
        ProtocolError: the line tells of no place.

    >>> answers_of("m,10,20,30,40,50")[GROUND]
    '<5H'
    """
    letter, places = read_line(line)
    if letter != "m" or not places:
        raise ProtocolError(f"{line[:40]!r} does not say what the ground sensors measure")
    return {**answers, GROUND: f"<{len(places)}H"}


def read_answers(
    asked: Sequence[int], buffer: bytes, answers: Mapping[int, str] = ANSWERS
) -> tuple[dict[int, Any] | None, bytes]:
    """What was asked in one chain, by code, and the bytes after it; ``None`` until it is whole.

    An image is a `Picture`, of mode 0 (gray) or 1 (colour); the rest are tuples of numbers.

    Raises:
        ProtocolError: an image of unknown mode or without a size.

    >>> read_answers([BATTERY, TEMPERATURE], bytes([1, 0, 25, 7]))
    ({158: (1,), 140: (25,)}, b'\\x07')
    """
    found, at = {}, 0
    for code in asked:
        if code not in answers:
            continue
        size = struct.calcsize(answers[code])
        if code == IMAGE:
            size = _image_size(buffer[at : at + 3])
        if at + size > len(buffer) or (code == IMAGE and at + 3 > len(buffer)):
            return None, buffer
        found[code] = _read(code, buffer[at : at + size], answers)
        at += size
    return found, buffer[at:]


def _image_size(header: bytes) -> int:
    if len(header) < 3:
        return 3
    mode, width, height = header
    if mode > 1 or not width or not height:
        raise ProtocolError(f"{header.hex(' ')} is no image: mode 0 or 1, width, height")
    return 3 + (1 + mode) * width * height


def _read(code: int, data: bytes, answers: Mapping[int, str]) -> Any:
    if code == IMAGE:
        return Picture(data[1], data[2], data[3:])
    return struct.unpack(answers[code], data)


# ---------------------------------------------------------------- what the robot reads


def split_requests(
    buffer: bytes, arguments: Mapping[int, int] = ARGUMENTS
) -> tuple[list[Request], bytes]:
    """Whole requests at the front of a stream to the robot, and the bytes after them.

    As in the firmware, unknown codes count as codes without arguments, and whatever is no
    number in a line of text counts as 0. It takes time in proportion to the bytes.

    Raises:
        ProtocolError: far too many bytes without an end.
    """
    requests: list[Request] = []
    at = _ZEROS.match(buffer).end()  # zeros between requests mean nothing
    while at < len(buffer):
        read = _read_chain if buffer[at] & 0x80 else _read_text
        request, end = read(buffer, at, arguments)
        if end < 0:
            break
        requests += [request] if request else []
        at = _ZEROS.match(buffer, end).end()
    if len(buffer) - at > LONGEST:
        raise ProtocolError(f"{len(buffer) - at} bytes without an end", requests)
    return requests, buffer[at:]


_ZEROS, _END = re.compile(rb"\0*"), re.compile(rb"[\r\n]")


def _read_chain(buffer: bytes, at: int, arguments: Mapping[int, int]) -> tuple[Request, int]:
    """A chain that begins here, and where the next request does, or -1 if it is not whole."""
    codes = []
    while at < len(buffer) and buffer[at]:
        end = at + 1 + arguments.get(buffer[at], 0)
        codes.append(Code(buffer[at], buffer[at + 1 : end]))
        at = end
    return tuple(codes), at + 1 if at < len(buffer) else -1


def _read_text(buffer: bytes, at: int, _: Mapping[int, int]) -> tuple[Request, int]:
    found = _END.search(buffer, at)
    if found is None:
        return (), -1
    letter, *numbers = buffer[at : found.start()].decode("latin-1").split(",")
    request = Text(letter, tuple(map(_number, numbers))) if letter else ()
    return request, found.end()


def _number(word: str) -> int:
    try:
        return int(word[:7])
    except ValueError:
        return 0

"""Codecs against the tables of the firmware: vectors here are typed by hand."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dntorch.robot.codecs import ProtocolError, Stream, rgb565, sercom, sercom2, wifi
from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.codecs.sercom import Code, Text
from dntorch.robot.codecs.wifi import Command, Empty, Sensors

# ---------------------------------------------------------------- vectors typed by hand

#: byte 0 header, 1 request, 2 settings, 3-4 left, 5-6 right, 7 LEDs, 8-19 RGB, 20 sound
COMMANDS = [
    ("80 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00", Command(request=0)),
    ("80 03 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00", Command()),
    ("80 02 00 e8 03 18 fc 00 00 00 00 00 00 00 00 00 00 00 00 00 00", Command(1000, -1000, 2)),
    (
        "80 01 06 ff ff 01 00 21 64 00 00 00 64 00 00 00 64 65 65 65 20",
        Command(-1, 1, 1, 6, 0x21, bytes([100, 0, 0, 0, 100, 0, 0, 0, 100, 101, 101, 101]), 32),
    ),
]  # fmt: skip

SENSORS_HEX = (
    "01 00 fe ff 03 00"  # 0 accelerometer 1, -2, 3
    "00 00 80 3f"  # 6 acceleration 1.0
    "00 00 b4 42"  # 10 orientation 90.0
    "00 00 34 c3"  # 14 inclination -180.0
    "0a 00 f6 ff 00 01"  # 18 gyroscope 10, -10, 256
    "00 00 00 3f 00 00 00 bf 00 00 20 41"  # 24 magnetometer 0.5, -0.5, 10.0
    "e7"  # 36 temperature -25
    "ff 0f 01 00 02 00 03 00 04 00 05 00 06 00 07 00"  # 37 proximity 4095, 1 ... 7
    "a0 0f 00 00 00 00 00 00 00 00 00 00 00 00 01 00"  # 53 ambient 4000, 0 ... 0, 1
    "d0 07"  # 69 distance 2000
    "01 00 02 00 03 00 04 00"  # 71 microphones 1, 2, 3, 4
    "ff 7f 00 80"  # 79 steps 32767, -32768
    "b0 03"  # 83 battery 944
    "01 02 03 04 0f"  # 85 card 1, 86 remote 2, 3, 4, 89 selector 15
    "10 00 20 00 30 00 40 00 50 00 60 00"  # 90 ground 16, 32, 48, 96 ambient 64, 80, 96
    "01 00"  # 102 button, 103 reserved
)
SENSORS = Sensors(
    (1, -2, 3), 1.0, 90.0, -180.0, (10, -10, 256), (0.5, -0.5, 10.0), -25,
    (4095, 1, 2, 3, 4, 5, 6, 7), (4000, 0, 0, 0, 0, 0, 0, 1), 2000, (1, 2, 3, 4),
    (32767, -32768), 944, 1, (2, 3, 4), 15, (16, 32, 48), (64, 80, 96), 1, 0,
)  # fmt: skip


@pytest.mark.parametrize("data, command", COMMANDS)
def test_wifi_command_by_hand(data, command):
    assert wifi.encode_command(command) == bytes.fromhex(data)
    assert wifi.decode_command(bytes.fromhex(data)) == command


def test_wifi_sensors_by_hand():
    data = bytes.fromhex(SENSORS_HEX)
    assert len(data) == 104
    assert wifi.decode_sensors(data) == SENSORS
    assert wifi.encode_sensors(SENSORS) == data


def test_wifi_packets_in_any_order_by_hand():
    sensors, pixels = bytes.fromhex(SENSORS_HEX), bytes.fromhex("f800 07e0 001f ffff") * 4800
    image = Picture(160, 120, pixels)
    firmware = b"\x01" + pixels + b"\x02" + sensors + b"\x03"
    webots = b"\x02" + sensors + b"\x01" + pixels
    assert wifi.split_packets(firmware) == ([image, SENSORS, Empty()], b"")
    assert wifi.split_packets(webots) == ([SENSORS, image], b"")


@pytest.mark.parametrize("data, rgb", [
    ("f800", (248, 0, 0)), ("07e0", (0, 252, 0)), ("001f", (0, 0, 248)), ("ffff", (248, 252, 248)),
    ("0841", (8, 8, 8)), ("0020", (0, 4, 0)), ("0001", (0, 0, 8)), ("8410", (128, 128, 128)),
])  # fmt: skip
def test_rgb565_by_hand(data, rgb):
    assert rgb565.decode(Picture(1, 1, bytes.fromhex(data))).tolist() == [[list(rgb)]]
    assert rgb565.encode(np.array([[rgb]], np.uint8)).hex() == data


def test_picture_is_row_major_and_gray_has_one_byte():
    picture = rgb565.decode(Picture(2, 2, bytes.fromhex("f800 07e0 001f 0000")))
    assert picture[0, 1].tolist() == [0, 252, 0] and picture[1, 0].tolist() == [0, 0, 248]
    gray = rgb565.decode(Picture(2, 1, bytes([7, 200])))
    assert gray.tolist() == [[[7, 7, 7], [200, 200, 200]]]
    with pytest.raises(ValueError, match="no image of 2x2"):
        rgb565.decode(Picture(2, 2, b"123"))


def test_sercom_binary_by_hand():
    code = {"D": 0xBC, "E": 0xBB, "N": 0xB2, "O": 0xB1, "Q": 0xAF, "P": 0xB0, "a": 0x9F,
            "A": 0xBF, "g": 0x99, "b": 0x9E, "t": 0x8C, "L": 0xB4, "M": 0xB3, "u": 0x8B,
            "W": 0xA9, "I": 0xB7}  # fmt: skip
    assert all(value == 256 - ord(letter) for letter, value in code.items())
    assert {*code.values()} == {*sercom.ARGUMENTS, *sercom.ANSWERS}
    assert sercom.chain(sercom.set_speed(-1, 300)) == bytes.fromhex("bc ff ff 2c 01 00")
    asked = [sercom.IMAGE, sercom.PROXIMITY, sercom.GET_STEPS]
    assert sercom.chain(*asked) == bytes.fromhex("b7 b2 af 00")
    answer = bytes.fromhex(
        "01 02 01 f8 00 00 1f"
        + "01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 01"
        + "fe ff 10 00 ee"
    )
    found, rest = sercom.read_answers(asked, answer)
    assert found == {
        sercom.IMAGE: Picture(2, 1, bytes.fromhex("f800 001f")),
        sercom.PROXIMITY: (1, 2, 3, 4, 5, 6, 7, 264),
        sercom.GET_STEPS: (-2, 16),
    }
    assert rest == b"\xee"
    for short in range(len(answer) - 1):
        assert sercom.read_answers(asked, answer[:short]) == (None, answer[:short])


def test_sercom_text_by_hand():
    assert sercom.text("J", 1, 52, 39, 8, -1, -1) == b"J,1,52,39,8,-1,-1\n"
    assert sercom.text("V") == b"V\n"
    welcome = b"\x0c\x07WELCOME to the SerCom protocol on e-Puck\r\nn,1,2,3,4,5,6,7,8\r\nq,-4,"
    lines, rest = sercom.split_lines(welcome)
    assert lines == ["WELCOME to the SerCom protocol on e-Puck", "n,1,2,3,4,5,6,7,8"]
    assert rest == b"q,-4,"
    assert sercom.read_line(lines[1]) == ("n", (1, 2, 3, 4, 5, 6, 7, 8))
    with pytest.raises(ProtocolError, match="no answer of numbers"):
        sercom.read_line("v,Version 2.0 January 2018 GCtronic")


@pytest.mark.parametrize("line, size", [("m,1,2,3", 6), ("m,1,2,3,4,5", 10)])
def test_the_ground_is_as_long_as_the_text_says(line, size):
    answers = sercom.answers_of(line)
    data = struct.pack("<5H", 1, 2, 3, 4, 5)[:size] + b"\x19" + b"rest"
    found, rest = sercom.read_answers([sercom.GROUND, sercom.TEMPERATURE], data, answers)
    assert found[sercom.GROUND] == tuple(range(1, size // 2 + 1))
    assert found[sercom.TEMPERATURE] == (25,) and rest == b"rest"
    for wrong in ("m", "n,1,2,3", "m,x"):
        with pytest.raises(ProtocolError):
            sercom.answers_of(wrong)


def test_sercom_requests_by_hand():
    stream = bytes.fromhex("bc 64 00 9c ff b7 00") + b"D,100,-100\rI\r\n" + bytes.fromhex("9e 00")
    assert sercom.split_requests(stream + b"J,1,4") == (
        [
            (Code(0xBC, b"\x64\0\x9c\xff"), Code(0xB7)),
            Text("D", (100, -100)),
            Text("I"),
            (Code(0x9E),),
        ],
        b"J,1,4",
    )


def test_sercom2_by_hand():
    data = bytes.fromhex("f7 00 64 00 9c ff" + 13 * "00" + "20")
    assert sercom2.set_actuators(Command(100, -100, sound=32)) == data
    assert sercom2.read_actuators(data[1:]) == Command(100, -100, request=0, sound=32)
    official = data + bytes.fromhex("f8 00")  # the loop of GCtronic's own client
    requests, rest = sercom.split_requests(official, sercom2.ARGUMENTS)
    assert requests == [(Code(0xF7, data[1:]), Code(0xF8))] and rest == b""
    without_button = bytes.fromhex(SENSORS_HEX)[:102] + b"\0"
    assert sercom2.encode_sensors(SENSORS) == without_button
    assert sercom2.decode_sensors(without_button) == SENSORS._replace(button=0)
    found, _ = sercom.read_answers([0xF7, 0xF8, 0xF5], without_button + b"\1", sercom2.ANSWERS)
    assert found == {0xF8: (without_button,), 0xF5: (1,)}


# ---------------------------------------------------------------- properties

#: A busy machine is no failure.
QUIET = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}

i8, i16 = st.integers(-128, 127), st.integers(-32768, 32767)
u8, u16 = st.integers(0, 255), st.integers(0, 65535)
f32 = st.floats(width=32, allow_nan=False)
commands = st.builds(Command, i16, i16, u8, u8, u8, st.binary(min_size=12, max_size=12), u8)
sensors = st.builds(
    Sensors, st.tuples(*[i16] * 3), f32, f32, f32, st.tuples(*[i16] * 3), st.tuples(*[f32] * 3),
    i8, st.tuples(*[u16] * 8), st.tuples(*[u16] * 8), u16, st.tuples(*[u16] * 4),
    st.tuples(i16, i16), u16, u8, st.tuples(u8, u8, u8), u8, st.tuples(*[u16] * 3),
    st.tuples(*[u16] * 3), u8, u8,
)  # fmt: skip
pictures = st.binary(min_size=1, max_size=64).map(
    lambda seed: Picture(160, 120, (seed * (38400 // len(seed) + 1))[:38400])
)
packets = st.one_of(pictures, sensors, st.just(Empty()))
lines = st.builds(lambda letter, args: Text(letter, tuple(args)), st.sampled_from("DEINQJ"),
                  st.lists(st.integers(-9999, 9999), max_size=6))  # fmt: skip
codes = st.one_of(
    st.builds(lambda a, b: Code(sercom.SET_SPEED, struct.pack("<hh", a, b)), i16, i16),
    st.sampled_from([sercom.IMAGE, sercom.PROXIMITY, 0xF8, 0x81]).map(Code),
    st.binary(min_size=19, max_size=19).map(lambda data: Code(0xF7, data)),
)
requests = st.one_of(lines, st.lists(codes, min_size=1, max_size=4).map(tuple))


def written(request):
    if isinstance(request, Text):
        return sercom.text(request.letter, *request.arguments)
    return sercom.chain(*(bytes([code]) + arguments for code, arguments in request))


def pieces(data, draw):
    """The bytes, cut at places that hypothesis draws."""
    cuts = sorted(draw(st.lists(st.integers(0, len(data)), max_size=12)))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)])]


def fed(split, parts):
    """Packets of a stream that comes in parts, and the error that ends it."""
    stream, found = Stream(split), []
    for part in parts:
        try:
            found += stream.feed(part)
        except ProtocolError as error:
            return found + error.packets, str(error)
    return found, None


@settings(max_examples=60, **QUIET)
@given(st.lists(packets, max_size=4), st.sampled_from([b"", b"\0more", b"\x80"]), st.data())
def test_any_split_of_the_robots_stream_gives_the_same_packets(sent, tail, data):
    stream = b"".join(map(wifi.encode_packet, sent)) + tail
    whole = fed(wifi.split_packets, [stream])
    assert whole[0] == sent and (whole[1] is None) == (tail == b"")
    assert fed(wifi.split_packets, pieces(stream, data.draw)) == whole


@settings(max_examples=200, **QUIET)
@given(st.lists(commands, max_size=6), st.sampled_from([b"", b"\x81"]), st.data())
def test_any_split_of_the_hosts_stream_gives_the_same_commands(sent, tail, data):
    stream = b"".join(map(wifi.encode_command, sent)) + tail
    whole = fed(wifi.split_commands, [stream])
    assert whole[0] == sent and (whole[1] is None) == (tail == b"")
    assert fed(wifi.split_commands, pieces(stream, data.draw)) == whole


@settings(max_examples=200, **QUIET)
@given(st.lists(requests, max_size=6), st.data())
def test_any_split_of_a_sercom_stream_gives_the_same_requests(sent, data):
    stream = b"".join(map(written, sent))

    def split(buffer):
        return sercom.split_requests(buffer, sercom2.ARGUMENTS)

    assert fed(split, pieces(stream, data.draw)) == (sent, None)


@settings(max_examples=200, **QUIET)
@given(commands, sensors)
def test_decode_of_encode_is_the_same(command, measured):
    assert wifi.decode_command(wifi.encode_command(command)) == command
    assert wifi.decode_sensors(wifi.encode_sensors(measured)) == measured
    data = sercom2.set_actuators(command)[1:]
    assert sercom2.read_actuators(data) == command._replace(request=0)
    same = measured._replace(button=0, reserved=0)
    assert sercom2.decode_sensors(sercom2.encode_sensors(measured)) == same


def test_every_pixel_survives_decode_and_encode():
    every = np.arange(65536).astype(">u2").tobytes()
    assert rgb565.encode(rgb565.decode(Picture(256, 256, every))) == every


@pytest.mark.parametrize("broken, said", [
    (Command(left=40000), "does not fit"), (Command(rgb=b"abc"), "12 bytes"),
])  # fmt: skip
def test_a_command_that_does_not_fit_is_refused(broken, said):
    with pytest.raises(ValueError, match=said):
        wifi.encode_command(broken)


# ---------------------------------------------------------------- a million random inputs

ASKED = [sercom.BATTERY, sercom.IMAGE, sercom.PROXIMITY]
READERS = [
    wifi.split_packets, wifi.split_commands, wifi.decode_command, wifi.decode_sensors,
    sercom2.decode_sensors, sercom.split_lines, sercom.split_requests,
    lambda data: sercom.split_requests(data, sercom2.ARGUMENTS),
    lambda data: sercom.read_answers(ASKED, data),
    lambda data: sercom.read_line(data.decode("latin-1")),
]  # fmt: skip


@pytest.mark.parametrize("reader", range(len(READERS)))
def test_random_bytes_raise_nothing_but_the_documented_error(reader):
    read, random, refused = READERS[reader], np.random.default_rng(reader), 0
    noise = random.bytes(1 << 20)
    # Half of the inputs begin as a real packet does, or the first byte would decide all.
    fronts = [b"", b"", b"", b"\x03\x02", b"\x80\x03", b"\xbc", b"D,1", b"\0\0\1\1\1"]
    starts = random.integers(0, (1 << 20) - 200, 100_000).tolist()
    exact = random.choice([19, 21, 103, 104], 100_000)  # where a reader wants just so many
    sizes = np.where(random.random(100_000) < 0.2, exact, random.integers(0, 40, 100_000)).tolist()
    for start, size in zip(starts, sizes):
        try:
            read(fronts[start & 7] + noise[start : start + size])
        except ProtocolError:
            refused += 1
    assert refused < 100_000, "no input was ever accepted"


def test_random_bytes_in_a_stream_leave_it_usable():
    random = np.random.default_rng(0)
    for split in (wifi.split_packets, wifi.split_commands, sercom.split_requests):
        stream = Stream(split)
        for _ in range(2000):
            try:
                stream.feed(random.bytes(int(random.integers(0, 400))))
            except ProtocolError:
                assert stream.rest == b""
            assert len(stream.rest) < 40_000

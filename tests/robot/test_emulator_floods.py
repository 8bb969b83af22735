"""The emulator when a host floods it, sends a stray byte, or goes in the midst of a command."""

import math
import socket
from urllib.parse import urlsplit

import pytest
from robot_worlds import Turntable

from dntorch.robot.clock import VirtualClock
from dntorch.robot.codecs import sercom, wifi
from dntorch.robot.emulated.camera import Camera
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.faults import Faults
from dntorch.robot.emulated.firmware import WifiFirmware, build_firmware
from dntorch.robot.emulated.firmware.wifi import UNREAD
from dntorch.robot.emulated.servers import CHUNK, MemoryServer, TcpServer
from dntorch.robot.transports import Tcp, transport_for


class Served:
    """An emulator in virtual time, stepped by hand."""

    def __init__(self, protocol: str, pacing: str = "firmware", server=None) -> None:
        self.clock, self.server = VirtualClock(), server or MemoryServer()
        firmware = build_firmware(protocol, pacing)
        self.emulator = Emulator(Turntable(), self.server, firmware, self.clock)
        self.emulator.start()
        self.link = None if server else self.server.connect()

    def step(self) -> None:
        self.clock.sleep_until(self.clock.now() + 1 / 32)

    def say(self, *parts: bytes) -> str:
        """Kinds of the packets that come in the step after."""
        self.link.to_robot += b"".join(parts)
        self.step()
        packets, rest = wifi.split_packets(bytes(self.link.to_host))
        self.link.to_host.clear()
        assert rest == b""
        return "".join(type(packet).__name__[0] for packet in packets)


def command(left: int, right: int, **others) -> bytes:
    return wifi.encode_command(wifi.Command(left, right, **others))


# ---------------------------------------------------------------- floods


class Counted(bytes):
    """Counts the bytes that are copied out of it, and out of what was copied."""

    copied = 0

    def __getitem__(self, key):
        found = super().__getitem__(key)
        if not isinstance(key, slice):
            return found
        Counted.copied += len(found)
        return Counted(found)


@pytest.mark.parametrize("piece", [b"\0", b"S\n", b"\r\n", b"\xb2\xb2\0", b"A,1,2\r"], ids=repr)
def test_the_work_of_splitting_requests_grows_with_the_bytes(piece: bytes, monkeypatch) -> None:
    monkeypatch.setattr(Counted, "copied", 0)
    flood = Counted(piece * (8192 // len(piece)) + b"D,5,6\n")
    requests, rest = sercom.split_requests(flood)
    assert requests[-1] == sercom.Text("D", (5, 6)) and rest == b""
    assert Counted.copied <= 2 * len(flood), "each request copies what follows"


def test_a_flood_of_questions_is_bounded_and_the_last_speed_is_heard() -> None:
    firmware = build_firmware("sercom")
    for _ in range(20):
        firmware.take(b"E\n" * 5000)
    firmware.take(b"D,5,6\nV\n")
    assert firmware.speeds == (5, 6)
    assert len(firmware.give(lambda: None, wifi.Sensors)) == firmware.QUEUE
    assert firmware.give(lambda: None, wifi.Sensors) == []


@pytest.mark.parametrize(("protocol", "data"), [("sercom", bytes(1)), ("wifi", b"\x80")])
def test_a_flood_and_its_end_leave_the_next_client_unharmed(protocol: str, data: bytes) -> None:
    served = Served(protocol, server=TcpServer())
    place = urlsplit(served.server.address)
    with socket.create_connection((place.hostname, place.port)) as flooding:
        flooding.setblocking(False)
        left, steps = memoryview(data * (3 << 20)), 0
        while left and steps < 1000:
            try:
                left = left[flooding.send(left) :]
            except BlockingIOError:
                served.step()
                steps += 1
        assert not left, "it takes no more bytes"
    with socket.create_connection((place.hostname, place.port), timeout=30) as other:
        other.sendall(b"D,5,6\n" if protocol == "sercom" else command(5, 6))
        for _ in range(1000):
            served.step()
            if served.emulator.speeds == (5, 6):
                break
    assert served.emulator.speeds == (5, 6)
    served.emulator.close()


def test_a_step_takes_no_more_than_a_chunk() -> None:
    link = MemoryServer().connect()
    link.to_robot += bytes(3 * CHUNK + 1)
    assert [len(link.receive()) for _ in range(5)] == [CHUNK, CHUNK, CHUNK, 1, 0]


def test_what_the_robot_of_webots_has_not_read_is_bounded() -> None:
    firmware = WifiFirmware("webots")
    for _ in range(100):
        firmware.take(command(1, 1) * 3000)
    assert len(firmware._buffer) <= UNREAD and firmware.speeds == (1, 1)


# ---------------------------------------------------------------- a stray byte


def test_a_chunk_of_commands_leaves_the_next_in_step() -> None:
    """A host that sends more than a step takes: what was cut is completed."""
    served = Served("wifi")
    served.say(command(1, 1) * (2 * CHUNK // 21), command(8, 8))
    served.step(), served.step()
    assert served.emulator.speeds == (8, 8)
    assert served.say(command(7, 7))[-2:] == "PS" and served.emulator.speeds == (7, 7)


def test_after_a_stray_byte_the_firmware_obeys_what_lies_there() -> None:
    served = Served("wifi")
    assert served.say(command(100, 100)) == "PS"
    served.say(b"\0", command(2, 1))  # of which the last byte is still to be read
    assert served.emulator.speeds == (2 << 8, 1 << 8)
    served.say(command(0, 0))
    assert served.emulator.speeds == (0, 0), "shifted by a byte, speed 0 is speed 0"
    served.say(bytes(3), command(0, 0))
    assert served.emulator.speeds == (-1100, 3), "shifted by four it is not"


def test_the_first_command_of_a_host_begins_with_80() -> None:
    served = Served("wifi")
    assert served.say(b"\0", command(2, 1), bytes(20)) == ""
    assert served.emulator.speeds == (0, 0)
    assert served.say(command(2, 1)) == "PS" and served.emulator.speeds == (2, 1)


def test_a_part_of_a_command_holds_the_stream_up() -> None:
    served, whole = Served("wifi"), command(7, 7)
    assert served.say(command(1, 1)) == "PS"
    assert served.say(whole[:9]) == "" and served.say() == ""
    assert served.say(whole[9:]) == "PS" and served.emulator.speeds == (7, 7)


def test_of_a_flood_that_ends_in_a_part_all_whole_commands_are_dropped() -> None:
    served, last = Served("wifi"), command(9, 9)
    served.say(command(1, 1))
    served.say(command(5, 5) * 6, last[:4])
    assert served.emulator.speeds == (1, 1)
    served.say(last[4:])
    assert served.emulator.speeds == (9, 9)


@pytest.mark.parametrize("left_over", [b"\0", b"\0" + command(3, 3), command(3, 3)[:9]])
def test_a_client_that_goes_out_of_step_is_followed_by_the_next(left_over: bytes) -> None:
    served = Served("wifi")
    served.say(command(100, 100), left_over)
    served.link.ended = True
    for _ in range(400):  # until what was sent fills the link and it breaks
        served.step()
    served.link = served.server.connect()
    assert served.say() == "" and served.say(command(4, 4)) == "PS"
    assert served.emulator.speeds == (4, 4)


def test_the_robot_of_webots_finds_its_place_again_after_a_byte_alone() -> None:
    served = Served("wifi", "webots")
    served.say(command(1, 1))
    served.say(b"\0")
    served.say(command(6, 6))
    assert served.emulator.speeds == (6, 6)


# ---------------------------------------------------------------- what makes it worse


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, -0.1, 1.1])
@pytest.mark.parametrize("name", [*Faults().chances])
def test_a_chance_is_from_0_to_1(name: str, wrong: float) -> None:
    with pytest.raises(ValueError, match=rf"{name}=.*: give a number from 0 to 1"):
        Faults(**{name: wrong})


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1.0])
def test_faults_last_for_seconds_and_a_camera_has_finite_numbers(wrong: float) -> None:
    for name in ("stall_seconds", "delay_seconds"):
        with pytest.raises(ValueError, match=f"{name}="):
            Faults(**{name: wrong})
    for name in ("exposure", "blur", "noise", "zoom", "fps", "latency"):
        with pytest.raises(ValueError, match=f"{name}=.*: give a number"):
            Camera(**{name: wrong})
    for k in range(3):
        gains = tuple(wrong if k == at else 1.0 for at in range(3))
        with pytest.raises(ValueError, match=rf"gains\[{k}\]=.*: give a number above 0"):
            Camera(gains)


# ---------------------------------------------------------------- addresses


@pytest.mark.parametrize("address", [
    "tcp://127.0.0.1:99999", "tcp://127.0.0.1:65536", "tcp://127.0.0.1:0", "tcp://127.0.0.1:²",
    "tcp://127.0.0.1:-1", "tcp://a..b:5", "tcp://a b", "tcp://:5", "tcp://", "serial://",
    "serial://a\0b", "127.0.0.1:5", "", "tcp://h:1:2", "tcp://" + 70 * "a",
])  # fmt: skip
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match=r"is no robot.*give"):
        transport_for(address)


@pytest.mark.parametrize("port", [-1, 0, 65536, 99999])
def test_a_port_is_one_of_65535(port: int) -> None:
    with pytest.raises(ValueError, match=f"port={port}: give"):
        Tcp("127.0.0.1", port)
    if port:
        with pytest.raises(ValueError, match=f"port={port}: give"):
            TcpServer(port=port)

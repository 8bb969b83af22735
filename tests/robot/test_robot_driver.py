"""The driver over a link in memory, in virtual time: no threads, every byte in view."""

import math
import os
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest

import dntorch
from dntorch.robot.clock import RealClock, VirtualClock
from dntorch.robot.codecs import sercom, sercom2, wifi
from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.dialects import Sercom, Sercom2, Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.servers import MemoryServer, PtyServer, TcpServer
from dntorch.robot.transports import LinkLost, Serial, Tcp, transport_for

IMAGE = wifi.encode_packet(Picture(160, 120, bytes.fromhex("f800") * 19200))
STOP = wifi.encode_command(wifi.Command())
BYE = bytes.fromhex("80" + 20 * "00")


def sensors(left=0, right=0):
    return wifi.encode_packet(wifi.Sensors(steps=(left, right), proximity=(7,) * 8))


class Bench:
    """A driver in front of a robot whose every byte the test writes."""

    def __init__(self, dialect=None, **arguments):
        self.clock, self.server = VirtualClock(), MemoryServer()
        self.driver = Driver(self.server.transport(), dialect or Wifi(), self.clock, **arguments)
        self.driver.connect()
        self.link = self.server.accept()

    def hear(self):
        return self.link.receive()

    def say(self, data, wait=0.0):
        self.link.offer(data)
        self.clock.sleep_until(self.clock.now() + wait)


def test_the_first_word_is_speed_zero():
    bench = Bench()
    assert bench.hear() == STOP == bytes.fromhex("80 03" + 19 * "00")


def test_a_command_is_one_send_in_motor_steps():
    bench, sent = Bench(), []
    bench.driver.transport.send = sent.append
    bench.driver.drive(math.tau / 10, -math.tau / 4)  # a tenth and a quarter turn a second
    bench.driver.drive(100.0, -100.0)
    assert [wifi.decode_command(data)[:2] for data in sent] == [(100, -250), (1100, -1100)]


@pytest.mark.parametrize("order", [IMAGE + sensors(), sensors() + IMAGE, b"\3" + IMAGE + sensors()])
def test_frames_come_in_either_order_of_packets(order):
    bench = Bench()
    assert bench.driver.frame is None and bench.driver.age == math.inf
    bench.say(order[:20000], 0.25)
    assert bench.driver.frame is None
    bench.say(order[20000:], 0.25)
    frame = bench.driver.frame
    assert frame.image.shape == (120, 160, 3) and (frame.image == (248, 0, 0)).all()
    assert frame.proximity.tolist() == [7.0] * 8 and frame.number == 1
    assert (frame.time, bench.driver.age) == (0.25, 0.25)


def test_only_the_newest_frame_is_kept():
    bench = Bench()
    bench.say(b"".join(IMAGE + sensors(step) for step in range(5)))
    assert bench.driver.frame.number == 5 and bench.driver.frame.steps[0] == 4


def test_a_reading_pairs_what_is_new():
    bench = Bench()
    bench.say(IMAGE + IMAGE + sensors(1) + sensors(2) + IMAGE + sensors(3))
    assert bench.driver.frame.number == 2  # (second image, 1), (third image, 2)


def test_steps_do_not_wrap():
    bench, true = Bench(), 0
    for turn in range(60):
        true += 20_000 if turn < 40 else -25_000
        bench.say(IMAGE + sensors((true + 32768) % 65536 - 32768, 5))
        expected = true - 20_000  # counted from the first frame
        assert bench.driver.frame.steps.tolist() == [expected, 0]


def test_garbage_stops_the_robot_and_closes_the_link():
    bench = Bench()
    bench.hear()
    bench.say(IMAGE + sensors() + b"\x55")
    assert bench.hear() == 3 * STOP and bench.hear() is None
    assert bench.driver.frame is None and "55 begins no packet" in str(bench.driver.lost)
    with pytest.raises(LinkLost, match="no link to the robot"):
        bench.driver.drive(1.0, 1.0)
    bench.clock.sleep_until(60.0)
    assert bench.server.accept() is None, "it made a new link that nobody asked for"


def test_a_closed_link_is_lost():
    bench = Bench()
    bench.link.close()
    bench.clock.sleep_until(0.1)
    assert isinstance(bench.driver.lost, LinkLost)


def test_long_silence_is_a_lost_link_but_a_stall_of_wifi_is_not():
    bench = Bench()
    bench.say(IMAGE + sensors())
    bench.clock.every(0.1, lambda: None)
    bench.clock.sleep_until(6.0)
    bench.say(IMAGE[:5], 9.0)
    assert bench.driver.lost is None
    bench.clock.sleep_until(17.0)
    assert "no byte for 10 s" in str(bench.driver.lost)


def test_reconnects_where_asked_with_speed_zero_first():
    bench = Bench(reconnect=True)
    bench.say(IMAGE + sensors(5))
    bench.say(b"\x00")
    bench.driver.drive(1.0, 1.0)  # there is no link: nothing to send, nothing raised
    bench.clock.every(0.1, lambda: None)
    bench.clock.sleep_until(0.5)
    assert bench.server.accept() is None
    bench.clock.sleep_until(1.2)
    bench.link = bench.server.accept()
    bench.driver.drive(0.0, 1.0)
    heard = bench.hear()
    assert heard[:21] == STOP and len(heard) == 42
    assert bench.driver.connections == 2 and bench.driver.frame is None
    bench.say(IMAGE + sensors(7))
    assert bench.driver.frame.number == 2


def test_close_says_speed_zero_three_times_and_ends():
    bench = Bench(reconnect=True)
    bench.hear()
    bench.driver.close()
    assert bench.hear() == 3 * BYE and bench.hear() is None
    bench.driver.close()
    bench.clock.sleep_until(9.0)
    assert bench.server.accept() is None


def test_ir_calibration_and_avoidance_are_never_asked_for():
    bench = Bench()
    bench.driver.drive(1.0, -1.0)
    bench.driver.stop()
    bench.driver.close()
    heard = bench.hear()
    assert len(heard) == 21 * 8 and set(heard[2::21]) == {0}


# ---------------------------------------------------------------- SerCom

LINES = b"\x0c\x07WELCOME to the SerCom protocol on e-Puck\r\nv,Version 1.2.2\r\nHW version: 6\r\n"
PICTURE = bytes([1, 2, 1]) + bytes.fromhex("07e0 001f")


def agreed(dialect):
    """A bench after the handshake: the robot falls back to images of 2x1."""
    bench = Bench(dialect)
    assert bench.hear() == bytes.fromhex("bc 00 00 00 00 00") + b"V\nV\nV\n"
    bench.say(LINES)
    assert bench.hear() == bytes.fromhex("bc 00 00 00 00 00") + b"J,1,52,39,8,-1,-1\n"
    bench.say(b"v,Version 1.2.2\r\nHW version: 6\r\nj\r")
    assert bench.hear() == b""
    bench.say(b"\n")
    assert bench.hear() == b"I\n"
    bench.say(b"i,1,2,1,8,4\r\n")
    return bench


def test_sercom_asks_for_one_frame_after_the_other():
    bench = agreed(Sercom())
    assert bench.hear() == bytes.fromhex("b7 b2 af 00")
    bench.driver.drive(math.tau / 10, 0.0)
    assert bench.hear() == bytes.fromhex("bc 64 00 00 00 00"), "it asks while it waits"
    bench.say(PICTURE + bytes(16) + bytes.fromhex("05 00 fb ff"))
    assert bench.driver.frame.image.tolist() == [[[0, 252, 0], [0, 0, 248]]]
    assert bench.hear() == bytes.fromhex("b7 b2 af 00")
    bench.driver.close()
    assert bench.hear() == 3 * (bytes.fromhex("bc 00 00 00 00 00") + b"S\n")


def test_sercom2_takes_all_sensors_at_once():
    bench = agreed(Sercom2())
    assert bench.hear() == bytes.fromhex("b7 f8 00")
    measured = wifi.Sensors(proximity=tuple(range(8)), steps=(3, -3))
    bench.say(PICTURE + sercom2.encode_sensors(measured))
    assert bench.driver.frame.proximity.tolist() == list(range(8))


@pytest.mark.parametrize("wrong", [bytes([1, 3, 1]) + bytes(6), bytes([9, 2, 1]) + bytes(4)])
def test_an_image_of_another_size_or_mode_loses_the_link(wrong):
    bench = agreed(Sercom())
    bench.hear()
    bench.say(wrong + bytes(20))
    assert bench.hear() == 3 * sercom.chain(sercom.set_speed(0, 0))
    assert bench.driver.lost is not None


CHAIN = bytes.fromhex("b7 b2 af 00")


def answer(step: int) -> bytes:
    return PICTURE + bytes(16) + sercom.set_speed(step, 0)[1:]


def started() -> Bench:
    bench = agreed(Sercom())
    assert bench.hear() == CHAIN
    return bench


@pytest.mark.parametrize("times", [2, 7, 1000])
def test_answers_that_nobody_asked_for_are_thrown_away(times):
    bench = started()
    bench.say(times * answer(1))
    for step in range(2, 6):
        assert bench.hear() == CHAIN
        bench.say(answer(step))
        assert bench.driver.frame.steps[0] == step - 1, "it answers late"
    assert bench.driver.frame.number == 5 and bench.driver.dialect._buffer == b""


def test_after_part_of_an_answer_it_asks_nothing_until_the_line_is_quiet():
    bench = started()
    bench.say(answer(1) + answer(1)[:10])
    bench.say(answer(1)[10:] + answer(1)[:3])
    bench.say(answer(1)[3:])
    assert bench.hear() == b"" and bench.driver.frame.number == 1
    bench.say(b"", 0.1)
    assert bench.hear() == b""
    bench.say(b"")
    assert bench.hear() == CHAIN
    bench.say(answer(2))
    assert bench.driver.frame.steps[0] == 1 and bench.driver.lost is None


def test_a_peer_that_never_ceases_is_refused():
    bench, sent = started(), 0
    flood = (answer(1) * 20)[:-1]
    while bench.driver.lost is None and sent < 10**6:
        bench.say(flood)
        sent += len(flood)
        assert len(bench.driver.dialect._buffer) < 100
    assert "that nobody asked for" in str(bench.driver.lost)
    assert bench.hear().endswith(3 * sercom.chain(sercom.set_speed(0, 0)))


def test_a_repeated_line_is_no_frame():
    bench = Bench(Sercom())
    for line in (LINES, b"j\r\n", 2 * b"i,1,2,1,8,4\r\n"):
        bench.say(line)
    assert CHAIN not in bench.hear()
    bench.say(b"", 0.1)
    assert bench.hear() == b""
    bench.say(b"")
    assert bench.hear() == CHAIN and bench.driver.lost is None


class Grounded(Sercom):
    """Asks for the ground as well."""

    asked = (*Sercom.asked, sercom.GROUND)


@pytest.mark.parametrize("places", [3, 5])
def test_the_answer_about_the_ground_is_as_long_as_the_robot_makes_it(places):
    bench = agreed(Grounded())
    assert bench.hear() == b"M\n"
    bench.say(b"m" + places * b",7" + b"\r\n")
    for step in (1, 2, 3):
        assert bench.hear() == bytes.fromhex("b7 b2 af b3 00")
        bench.say(answer(step) + places * b"\7\0")
        assert bench.driver.frame.steps[0] == step - 1
    assert bench.driver.lost is None


# ---------------------------------------------------------------- real links


def answered(server, driver):
    """Speak as a robot over a real link, in real time, until a frame has come."""
    clock = RealClock()
    driver.connect()
    end = clock.now() + 5.0
    link, heard, rest = None, b"", IMAGE + sensors(4)
    while driver.frame is None and clock.now() < end:
        link = link or server.accept()
        if link is not None:
            heard += link.receive() or b""
            rest = rest[link.offer(rest) :] if heard else rest
        clock.sleep_until(clock.now() + 0.002)
    assert driver.frame is not None
    driver.close()
    while len(heard) < 84 and clock.now() < end:
        heard += link.receive() or b""
    link.close()
    return heard


@pytest.mark.parametrize("kind", ["tcp", "serial"])
def test_real_links_carry_frames_and_stops(kind):
    threads = threading.active_count()
    if kind == "tcp":
        server = TcpServer()
        transport = Tcp(server.host, server.port, wait=0.01)
    else:
        pytest.importorskip("serial")
        server = PtyServer()
        transport = Serial(server.path, wait=0.01)
    heard = answered(server, Driver(transport, Wifi()))
    server.close()
    assert heard == STOP + 3 * BYE
    assert threading.active_count() == threads, "a thread is left over"


def test_tcp_does_not_wait_to_send():
    server = TcpServer()
    transport = Tcp(server.host, server.port)
    transport.open()
    assert transport._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    transport.close()
    server.close()
    with pytest.raises(OSError):
        Tcp(server.host, server.port, patience=0.2).open()


def test_serial_without_pyserial_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(ImportError, match="pip install"):
        Serial(os.devnull).open()


@pytest.mark.parametrize("wrong", ["udp://here", "tcp://", "tcp://here:x", "192.168.1.1"])
def test_an_address_says_what_it_should_be(wrong):
    with pytest.raises(ValueError, match="tcp://HOST"):
        transport_for(wrong)


def test_robots_need_neither_simulation_nor_serial_line_to_be_imported():
    program = (
        "import sys, importlib, pkgutil, types\n"
        "missing = 'torch', 'gymnasium', 'pybullet', 'serial', 'cv2'\n"
        "sys.modules.update(dict.fromkeys(missing))\n"
        "package = sys.modules['dntorch'] = types.ModuleType('dntorch')\n"
        f"package.__path__ = {list(dntorch.__path__)!r}\n"
        "import dntorch.robot\n"
        "for part in pkgutil.walk_packages(dntorch.robot.__path__, 'dntorch.robot.'):\n"
        "    importlib.import_module(part.name)\n"
        "print(*[name for name in sys.modules if name.startswith('dntorch.robot')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) > 15


def test_virtual_events_keep_their_order_and_do_not_drift():
    clock, seen = VirtualClock(), []
    clock.every(0.1, lambda: seen.append(("a", clock.now())))
    clock.every(0.25, lambda: seen.append(("b", clock.now())))
    clock.every(0.25, lambda: seen.append(("c", clock.now())))
    clock.sleep_until(1000.0)
    times = np.array([time for name, time in seen if name == "a"])
    assert np.array_equal(times, np.arange(1, len(times) + 1) * 0.1)
    assert "".join(name for name, _ in seen[:11]) == "aabcaaabcaa"

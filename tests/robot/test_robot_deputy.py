"""The process that stops the robot when the one that drives it can not."""

import os
import select
import signal
import socket
import subprocess
import sys
import time

import pytest
from robot_worlds import Turntable
from waiting import LONG, wait

from dntorch.robot.clock import RealClock
from dntorch.robot.deputy import Deputy
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.firmware import SercomFirmware, WifiFirmware
from dntorch.robot.emulated.servers import MemoryServer, PtyServer, TcpServer
from dntorch.robot.transports import Tcp

STOP = b"stop!"


@pytest.fixture
def link():
    ours, robots = socket.socketpair()
    with ours, robots:
        ours.setblocking(False)  # as a socket with a timeout is
        yield ours, robots


def heard(robots: socket.socket, seconds: float) -> bytes:
    return robots.recv(100) if select.select([robots], [], [], seconds)[0] else b""


def test_it_stops_a_robot_that_moves_and_nobody_speaks_of(link):
    ours, robots = link
    deputy = Deputy(ours.fileno(), 0.3, STOP)
    began = time.monotonic()
    assert deputy.hear(True)
    assert heard(robots, LONG) == STOP and time.monotonic() - began >= 0.3
    assert heard(robots, 1.0) == b"", "once is enough until it moves again"
    deputy.hear(True)
    assert heard(robots, LONG) == STOP
    deputy.dismiss()


def test_it_is_silent_while_the_robot_stands_or_its_owner_speaks(link):
    ours, robots = link
    deputy = Deputy(ours.fileno(), 2.0, STOP)
    for _ in range(30):
        deputy.hear(True)
        assert heard(robots, 0.1) == b""
    deputy.hear(False)
    assert heard(robots, 3.0) == b""
    deputy.dismiss()
    ours.close()
    assert robots.recv(100) == b"", "a copy of the link is left open"


def test_it_stops_the_robot_when_its_owner_is_gone_and_ends(link):
    ours, robots = link
    deputy = Deputy(ours.fileno(), 60.0, STOP)
    deputy._process.stdin.close()  # as the kernel does for the dead
    assert heard(robots, LONG) == STOP
    assert deputy._process.wait(LONG) == 0


def test_where_there_is_no_room_it_tries_again(link):
    ours, robots = link
    full = 0
    with pytest.raises(BlockingIOError):
        while True:
            full += ours.send(bytes(1 << 16))
    deputy = Deputy(ours.fileno(), 0.1, STOP)
    deputy.hear(True)
    time.sleep(0.5)
    came = b""
    while not came.endswith(STOP):
        assert select.select([robots], [], [], LONG)[0]
        came = (came + robots.recv(1 << 16))[-100:]
    deputy.dismiss()


def test_a_dead_deputy_is_noticed(link):
    deputy = Deputy(link[0].fileno(), 60.0, STOP)
    deputy._process.kill()
    deputy._process.wait()
    assert not deputy.hear(True)
    deputy.dismiss()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_what_ends_a_whole_group_spares_it(link, number):
    ours, robots = link
    deputy = Deputy(ours.fileno(), 0.1, STOP)
    deputy.hear(True)
    assert heard(robots, LONG) == STOP  # it is up
    assert os.getsid(deputy._process.pid) == deputy._process.pid
    os.kill(deputy._process.pid, number)
    deputy.hear(True)
    assert heard(robots, LONG) == STOP
    deputy.dismiss()


# ---------------------------------------------------------------- a driver and its deputy


def test_a_driver_without_its_deputy_does_not_move():
    server = TcpServer()
    with Emulator(Turntable(), server, WifiFirmware()) as robot:
        driver = Driver(Tcp(server.host, server.port), Wifi())
        driver.watch(60.0)
        driver.connect()
        driver.drive(0.6, -0.6)
        assert wait(lambda: any(robot.speeds))
        driver._deputy._process.kill()
        driver._deputy._process.wait()
        driver.drive(0.6, -0.6)
        assert "has ended" in str(driver.lost)
        assert wait(lambda: not any(robot.speeds))
        driver.close()


def test_a_closed_driver_leaves_no_process_and_no_descriptor():
    server = TcpServer()
    with Emulator(Turntable(), server, WifiFirmware()):
        before = os.listdir("/proc/self/fd") if os.path.exists("/proc/self/fd") else []
        driver = Driver(Tcp(server.host, server.port), Wifi())
        driver.watch(60.0)
        for _ in range(2):
            driver.connect()
            process = driver._deputy._process
            driver.close()
            assert process.returncode == 0
        if before:  # the emulator keeps its end until it can send no more
            assert len(os.listdir("/proc/self/fd")) <= len(before) + 2


def test_in_memory_there_is_nothing_to_watch():
    driver = Driver(MemoryServer().transport(), Wifi())
    driver.watch(1.0)
    driver.connect()
    assert driver._deputy is None
    driver.close()


#: Drives for ever; a line on its standard input holds the interpreter up.
PROGRAM = """
import ctypes, select, sys, time
from dntorch.robot.dialects import DIALECTS
from dntorch.robot.driver import Driver
from dntorch.robot.safety import Guard
from dntorch.robot.transports import transport_for

driver = Driver(transport_for(sys.argv[1]), DIALECTS[sys.argv[2]]())
if "alone" in sys.argv:
    Driver.watch = lambda self, limit: None
with Guard(driver) as guard:
    while True:
        guard.drive(0.6, -0.6)
        time.sleep(1 / 32)
        if select.select([sys.stdin], [], [], 0)[0]:
            sys.stdin.readline()
            ctypes.PyDLL(None).sleep(3600)
"""


class Remembering(WifiFirmware):
    """Keeps for which steps of the world it was told to move."""

    def __init__(self):
        super().__init__()
        self.moved = 0

    def _obey(self, data):
        super()._obey(data)
        self.moved += any(self.speeds)


@pytest.mark.parametrize("fate", ["killed", "suspended", "held up"])
@pytest.mark.parametrize("alone", [False, True])
def test_the_robot_stops_although_the_program_can_not(fate, alone):
    server, firmware = TcpServer(), Remembering()
    with Emulator(Turntable(), server, firmware) as robot, subprocess.Popen(
        [sys.executable, "-c", PROGRAM, server.address, "wifi", *["alone"] * alone],
        stdin=subprocess.PIPE,
    ) as program:  # fmt: skip
        try:
            assert wait(lambda: firmware.moved > 10, 60.0)
            if fate == "held up":
                program.stdin.write(b"\n")
                program.stdin.flush()
                before = -1
                while firmware.moved > before:  # until nothing more is commanded
                    before = firmware.moved
                    time.sleep(0.3)
            else:
                name = {"killed": signal.SIGKILL, "suspended": signal.SIGSTOP}[fate]
                program.send_signal(name)
            if alone:
                RealClock().sleep_until(RealClock().now() + 2.0)
                assert any(robot.speeds), "this test shows nothing: it stops without a deputy"
            else:
                assert wait(lambda: not any(robot.speeds))
        finally:
            program.kill()


def test_it_speaks_the_language_of_a_serial_line():
    pytest.importorskip("serial")
    server, firmware = PtyServer(), SercomFirmware()
    with Emulator(Turntable(), server, firmware) as robot, subprocess.Popen(
        [sys.executable, "-c", PROGRAM, server.address, "sercom"], stdin=subprocess.PIPE
    ) as program:  # fmt: skip
        try:
            assert wait(lambda: any(robot.speeds), 60.0)
        finally:
            program.kill()
        assert wait(lambda: not any(robot.speeds))

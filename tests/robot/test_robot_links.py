"""What links do to a driver: they break, are unplugged, and keep what nobody has read."""

import os
import threading
import time

import numpy as np
import pytest
from waiting import wait

from dntorch.robot.clock import RealClock, VirtualClock
from dntorch.robot.codecs import wifi
from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.servers import MemoryServer, TcpServer
from dntorch.robot.link import Arrivals, LinkLost
from dntorch.robot.safety import Guard
from dntorch.robot.transports import Serial, Tcp

IMAGE = wifi.encode_packet(Picture(160, 120, bytes(38400)))


def reading(step: int = 0) -> bytes:
    return IMAGE + wifi.encode_packet(wifi.Sensors(steps=(step, 0)))


# ---------------------------------------------------------------- how old it may be


class Reader:
    """A link of which the test says what waits on it, and how long each call takes."""

    def __init__(self):
        self.time = 100.0
        self.arrivals = Arrivals(0.05, lambda: self.time)

    def read(self, waiting=False, waited=0.0, reading=0.0, data=b"x", whole=True) -> float:
        """s that it may have lain there when `read` is back."""

        def ready(seconds):
            self.time += waited if seconds else 0.0
            return bool(data) if seconds else waiting

        def take():
            self.time += reading
            return data, whole

        self.arrivals.read(ready, take)
        return round(self.time - self.arrivals.arrived, 6)


def test_who_waits_for_bytes_knows_when_they_came():
    assert Reader().read(waiting=False, waited=0.04) == 0.0
    assert Reader().read(waiting=False, waited=0.06) == 0.0  # a busy machine


def test_what_lay_there_may_have_come_since_the_link_was_last_empty():
    reader = Reader()
    reader.read(waited=0.05, data=b"")
    reader.time += 1.5  # suspended
    assert reader.read(waiting=True, whole=False) == 1.55
    assert reader.read(waiting=True, reading=0.1) == 1.65  # it was not all
    reader.time += 0.01
    assert reader.read(waiting=True) == 0.11


def test_who_was_suspended_while_waiting_or_reading_does_not_know():
    assert Reader().read(waiting=False, waited=1.5) == 1.5
    reader = Reader()
    assert reader.read(waiting=False, waited=0.02, reading=1.5) == 1.5
    assert reader.read(waiting=True) == 1.5  # the link was empty before that, not after it


class Passing(VirtualClock):
    """Time in which one can be late."""

    real = True


class Behind:
    """A driver whose reader is as late as the test says."""

    def __init__(self, clock=Passing):
        self.clock, server = clock(), MemoryServer()
        self.driver = Driver(server.transport(), Wifi(), self.clock)
        self.driver.connect()
        self.link = server.accept()

    def say(self, step: int, behind: float = 0.0, wait: float = 0.1):
        self.driver.transport.arrived = self.clock.now() - behind
        self.link.offer(reading(step))
        self.clock.sleep_until(self.clock.now())
        self.clock.sleep_until(self.clock.now() + wait)
        return self.driver.frame


def test_a_frame_is_as_old_as_it_may_be():
    bench = Behind()
    bench.say(0)
    assert bench.say(1, behind=0.3).steps[0] == 1
    assert bench.driver.age == pytest.approx(0.3 + 0.1)


def test_in_virtual_time_nobody_is_late():
    bench = Behind(VirtualClock)
    bench.say(0)
    assert bench.say(1, behind=30.0).steps[0] == 1 and bench.driver.age == pytest.approx(0.1)
    server = TcpServer()
    driver = Driver(Tcp(server.host, server.port), Wifi(), VirtualClock())
    driver.watch(0.5)
    driver.connect()
    assert driver._deputy is None
    driver.close()
    server.close()


def test_who_is_suspended_after_reading_knows_how_old_it_is():
    bench = Behind()
    bench.say(0)
    feed = bench.driver.dialect.feed

    def suspended(data, time):
        bench.clock._now += 2.0 * bool(data)
        return feed(data, time)

    bench.driver.dialect.feed = suspended
    bench.say(1)
    assert bench.driver.age >= 2.0


def test_after_a_gap_all_that_lay_there_is_passed_over_and_the_first_after_it():
    bench = Behind()
    bench.say(0)
    bench.clock.sleep_until(2.0)
    seen = [int(bench.say(1, behind=1.5, wait=0.0).steps[0])]  # false ends: more is on its way
    seen += [int(bench.say(step).steps[0]) for step in range(2, 10)]
    assert seen == 7 * [0] + [8, 9], seen
    assert bench.driver.age == pytest.approx(0.1)


# ---------------------------------------------------------------- an unplugged line


class Line:
    """A pseudo-terminal that can be unplugged, at a path that stays."""

    def __init__(self, folder):
        self.path = folder / "robot"
        self.plug()

    def plug(self):
        import tty

        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path.symlink_to(os.ttyname(self.slave))

    def unplug(self):
        os.close(self.master)
        os.close(self.slave)
        self.path.unlink()

    def speak(self, until) -> bool:
        """As a robot that streams."""
        rest, data = b"", reading(3)

        def some():
            nonlocal rest
            rest = rest or data
            try:
                rest = rest[os.write(self.master, rest) :]
            except BlockingIOError:
                pass
            return until()

        return wait(some)


@pytest.fixture
def line(tmp_path):
    pytest.importorskip("serial")
    return Line(tmp_path)


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd")) if os.path.exists("/proc/self/fd") else 0


@pytest.mark.parametrize("what", ["stop", "close", "drive", "pump", "transport.close"])
def test_nothing_but_a_lost_link_comes_of_an_unplugged_line(what, line):
    driver = Driver(Serial(str(line.path)), Wifi(), VirtualClock())
    driver.connect()
    line.unplug()
    before = descriptors()
    if what == "drive":
        with pytest.raises(LinkLost):
            for _ in range(2):
                driver.drive(1.0, 1.0)
    elif what == "transport.close":
        driver.transport.close()
    else:
        getattr(driver, what)()
    driver.close()
    assert driver.lost is not None
    if before:
        assert descriptors() < before, "a descriptor is left open"


def test_a_line_unplugged_while_it_is_opened_is_a_lost_link(line, monkeypatch):
    import termios

    import serial

    def unplugged(*_, **__):
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr(serial, "Serial", unplugged)
    with pytest.raises(LinkLost, match="Input/output"):
        Serial(str(line.path)).open()
    line.unplug()


def test_an_unplugged_line_is_made_anew_as_a_connection_is(line):
    threads = threading.active_count()
    driver = Driver(Serial(str(line.path), wait=0.01), Wifi(), reconnect=True, retry=0.05)
    with Guard(driver) as guard:
        assert line.speak(lambda: driver.frame is not None)
        guard.drive(0.5, 0.5)
        line.unplug()
        assert wait(lambda: driver.lost is not None)
        assert guard.drive(0.5, 0.5) == (0.0, 0.0)
        assert wait(lambda: "could not open" in str(driver.lost))
        line.plug()
        assert wait(lambda: driver.lost is None)
        assert line.speak(lambda: driver.frame is not None)
        assert driver.connections == 2 and driver.lost is None
    line.unplug()
    assert threading.active_count() == threads


def test_a_line_that_takes_nothing_does_not_hold_up_the_end(line, monkeypatch):
    monkeypatch.setattr(Serial, "FLUSH", 0.1)
    link = Serial(str(line.path))
    link.open()
    link._port.flush = lambda: time.sleep(3600)  # what a stalled line does
    link.close()
    line.unplug()


# ---------------------------------------------------------------- threads that live on


@pytest.mark.parametrize("kind", ["every", "background"])
def test_a_thread_outlives_what_fails_in_it_and_says_so(kind, monkeypatch):
    printed, called = [], []
    monkeypatch.setattr(threading, "excepthook", printed.append)

    def action():
        called.append(1)
        raise RuntimeError(f"time {len(called)}")

    start = {"every": lambda: RealClock().every(0.01, action),
             "background": lambda: RealClock().background(action)}[kind]  # fmt: skip
    ongoing = start()
    assert wait(lambda: len(called) >= 3)
    ongoing.cancel()
    assert len(printed) == 1 and "time 1" in str(printed[0].exc_value)
    assert "time" in str(ongoing.failed)


def test_whatever_fails_in_the_reader_ends_the_link():
    bench = Behind()
    bench.driver.dialect.feed = lambda data, time: 1 / 0
    bench.say(0)
    assert isinstance(bench.driver.lost, ZeroDivisionError)
    with pytest.raises(LinkLost, match="no link"):
        bench.driver.drive(1.0, 1.0)


def test_the_clock_of_ages_goes_on_while_the_computer_sleeps():
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    if boot is None:
        pytest.skip("this system has no such clock")
    assert abs(RealClock().now() - time.clock_gettime(boot)) < 5.0


# ---------------------------------------------------------------- another robot


def test_wheel_steps_begin_anew_with_the_link():
    bench = Behind()
    bench.driver.reconnect, bench.driver.retry = True, 0.0
    bench.say(20_000)
    assert bench.say(20_300).steps.tolist() == [300, 0]
    server = bench.driver.transport.server
    bench.link.close()
    bench.clock.sleep_until(bench.clock.now() + 0.1)
    bench.clock.sleep_until(bench.clock.now() + 0.1)
    bench.link = server.accept()
    frame = bench.say(0)  # it was switched off and on
    assert frame.steps.tolist() == [0, 0] and frame.link == bench.driver.connections == 2
    assert bench.say(7).steps.tolist() == [7, 0]
    assert np.issubdtype(frame.steps.dtype, np.int64)


def test_a_link_that_is_made_while_the_driver_closes_is_closed():
    bench = Behind()
    bench.driver.reconnect, bench.driver.retry = True, 0.0
    bench.driver._lose(LinkLost("gone"))
    open_ = bench.driver.transport.open

    def slow():
        open_()
        bench.driver.close()

    bench.driver.transport.open = slow
    bench.driver.pump()
    assert bench.driver.transport._link is None and bench.driver.connections == 1


def test_what_cannot_be_opened_leaves_no_link_behind():
    bench = Behind()
    bench.driver.close()
    bench.driver.transport.send = lambda data: (_ for _ in ()).throw(OSError("broken"))
    with pytest.raises(OSError, match="broken"):
        bench.driver.connect()
    assert bench.driver.transport._link is None

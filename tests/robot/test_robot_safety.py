"""Everything that stops the robot, and that without it the robot would not stop."""

import math
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import dntorch
from dntorch.body import STEPS_PER_TURN
from dntorch.process import REQUESTS
from dntorch.robot.clock import RealClock, VirtualClock
from dntorch.robot.codecs import wifi
from dntorch.robot.codecs.rgb565 import Picture
from dntorch.robot.contract import Frame
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.servers import MemoryServer
from dntorch.robot.safety import Guard, Limits
from dntorch.robot.transports import LinkLost

SET = wifi.encode_packet(Picture(160, 120, bytes(38400))) + wifi.encode_packet(wifi.Sensors())


class Bench:
    """A guarded driver in virtual time before a robot that streams while ``alive``."""

    def __init__(self, guard=Guard, limits=None, fps=10, **arguments):
        self.clock, server = VirtualClock(), MemoryServer()
        self.driver = Driver(server.transport(), Wifi(), self.clock, **arguments)
        self.guard = guard(self.driver, self.clock, limits)
        self.server, self.alive = server, True
        self.sent = []  # (time, left, right) of every command that arrived
        self.guard.connect()
        self.link = server.accept()
        self.clock.every(1 / fps, self.robot)
        self.clock.background(self.listen)

    def robot(self):
        if self.alive:
            self.link.offer(SET)

    def listen(self):
        commands, rest = wifi.split_commands(self.link.receive() or b"")
        assert rest == b""
        self.sent += [(self.clock.now(), c.left, c.right) for c in commands]

    def wait(self, seconds):
        self.clock.sleep_until(self.clock.now() + seconds)

    def run(self, seconds, speeds=(0.6, -0.6), dt=1 / 32):
        for _ in range(round(seconds / dt)):
            self.guard.drive(*speeds)
            self.wait(dt)

    @property
    def moves(self):
        """Whether the last speed that the robot was told is not 0."""
        return any(self.sent[-1][1:])

    def stopped_at(self, after):
        """Time of the first of the speeds 0 that the robot has kept since."""
        times = [time for time, *speeds in self.sent if any(speeds)]
        last = max(times, default=-1.0)
        zeros = [time for time, *speeds in self.sent if not any(speeds) and time >= last]
        return next(time for time in zeros if time >= after)


def silenced(**methods):
    """A guard without one of its protections."""
    return type("Silenced", (Guard,), methods)


FEARLESS = silenced(_stale=lambda self: None)
UNWATCHED = silenced(check=lambda self: None)
UNLIMITED = silenced(_limited=lambda self, left, right: (left, right))


# ---------------------------------------------------------------- watchdog


def test_a_stalled_control_loop_stops_the_robot():
    bench = Bench()
    bench.run(1.0)
    last, _, _ = bench.sent[-1]
    bench.wait(0.4)
    assert bench.moves
    bench.wait(2.0)
    assert not bench.moves and bench.guard.tripped == "the control loop stalled"
    assert bench.stopped_at(last) - last <= 0.5
    assert [speeds for _, *speeds in bench.sent[-4:]] == [[95, -95]] + 3 * [[0, 0]]
    bench.guard.drive(0.6, -0.6)
    assert bench.guard.tripped is None
    bench = Bench(UNWATCHED)
    bench.run(1.0)
    bench.wait(2.0)
    assert bench.moves, "this test shows nothing: the robot stops without a watchdog"


@pytest.mark.parametrize("stall", [0.6, 6.0])
def test_frames_that_stop_coming_stop_the_robot_and_a_fresh_one_lets_it_go_on(stall):
    bench = Bench()
    bench.run(1.0)
    bench.alive, last = False, bench.driver.frame.time
    bench.run(stall)
    assert not bench.moves and bench.guard.tripped == "no fresh frame"
    assert bench.stopped_at(last) - last <= 0.5
    assert sum(time == bench.stopped_at(last) for time, *_ in bench.sent) >= 3
    bench.alive = True
    bench.run(0.5)
    assert bench.moves and bench.guard.tripped is None
    bench = Bench(FEARLESS)
    bench.run(1.0)
    bench.alive = False
    bench.run(stall)
    assert bench.moves, "this test shows nothing: the robot stops without looking at ages"


def test_both_loops_stalled_at_once_stop_the_robot():
    bench = Bench()
    bench.run(1.0)
    bench.alive, last = False, bench.driver.frame.time
    bench.wait(3.0)
    assert bench.stopped_at(last) - last <= 0.5 and not bench.moves


def test_no_motion_before_the_first_frame():
    for guard, moves in ((Guard, False), (FEARLESS, True)):
        bench = Bench(guard)
        bench.alive = False
        bench.run(1.0)
        assert bench.moves is moves
    bench = Bench()
    bench.alive = False
    bench.run(3.0)
    bench.alive = True
    bench.run(0.3)
    assert bench.moves


# ---------------------------------------------------------------- limits


def test_speed_is_capped():
    for guard, fastest in ((Guard, 201), (UNLIMITED, 1100)):
        bench = Bench(guard)
        bench.run(1.0, (50.0, -50.0))
        assert max(abs(speed) for _, *speeds in bench.sent for speed in speeds) == fastest
    assert round(Limits().speed * STEPS_PER_TURN / math.tau) == 201


def test_speed_changes_no_faster_than_the_slew_limit():
    for guard, holds in ((Guard, True), (UNLIMITED, False)):
        bench = Bench(guard, Limits(slew=4.0))
        for speeds in ((1.2, 1.2), (-1.2, 1.2)):
            bench.run(1.0, speeds)
        steps = np.abs(np.diff([left for _, left, _ in bench.sent])) * math.tau / STEPS_PER_TURN
        allowed = 4.0 / 32 + math.tau / STEPS_PER_TURN
        assert bool(steps[6:].max() <= allowed) is holds


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_no_number_stops_the_robot_and_is_an_error(wrong):
    bench = Bench()
    bench.run(1.0)
    assert bench.moves
    with pytest.raises(ValueError, match="finite"):
        bench.guard.drive(0.5, wrong)
    bench.wait(0.0)
    assert [speeds for _, *speeds in bench.sent[-3:]] == 3 * [[0, 0]]


@pytest.mark.parametrize("arguments, said", [
    ({"speed": 0.0}, "speed=0.0"), ({"watchdog": math.inf}, "watchdog=inf"),
    ({"slew": -1.0}, "slew=-1.0"), ({"check": 0.4}, "at most half"),
])  # fmt: skip
def test_limits_without_sense_are_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        Limits(**arguments)


# ---------------------------------------------------------------- ways out


def test_leaving_the_block_stops_and_closes():
    for error in (None, RuntimeError):
        bench = Bench()
        try:
            with bench.guard:
                bench.link = bench.server.accept()
                bench.run(1.0)
                if error:
                    raise error
        except RuntimeError:
            pass
        bench.listen()
        assert [speeds for _, *speeds in bench.sent[-4:]] == 4 * [[0, 0]]
        assert bench.link.receive() is None
        with pytest.raises(LinkLost):
            bench.guard.drive(0.0, 0.0)


def test_garbage_from_the_robot_stops_it():
    bench = Bench()
    bench.run(1.0)
    bench.link.offer(b"\x77")
    bench.wait(0.0)
    bench.listen()
    assert [speeds for _, *speeds in bench.sent[-3:]] == 3 * [[0, 0]]


def test_motion_after_a_reconnect_waits_for_a_frame_of_the_new_link():
    bench = Bench(reconnect=True)
    bench.run(1.0)
    bench.alive = False
    bench.link.close()
    bench.run(1.5)
    assert bench.driver.connections == 2 and bench.guard.tripped == "no frame yet"
    bench.sent = []
    bench.link = bench.server.accept()
    bench.run(0.5)
    assert len(bench.sent) > 5 and not any(any(speeds) for _, *speeds in bench.sent)
    bench.alive = True
    bench.run(0.5)
    assert bench.moves


PROGRAM = """
import os, signal, sys, time, types
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in background
package = sys.modules["dntorch"] = types.ModuleType("dntorch")  # no need to wait for torch
package.__path__ = [{path!r}]
from dntorch.robot.clock import RealClock
from dntorch.robot.contract import Frame
from dntorch.robot.safety import Guard

class Log:  # a robot that writes what it is told
    connections = 1
    age = 0.0
    frame = Frame(None, None, None, 0.0, 1)
    def say(self, word): os.write(1, (word + "\\n").encode())
    def connect(self): self.say("connect")
    def drive(self, left, right): {drive}
    def stop(self): self.say("stop")
    def close(self): self.say("close")

guard = Guard(Log())
{body}
"""

BODIES = {
    "exit": "guard.__enter__(); guard.drive(1.0, 1.0); sys.exit(0)",
    "end": "guard.__enter__(); guard.drive(1.0, 1.0)",
    "sigterm": "with guard:\n guard.drive(1., 1.); os.kill(os.getpid(), 15); time.sleep(9)",
    "sigint": "with guard:\n guard.drive(1., 1.); os.kill(os.getpid(), 2); time.sleep(9)",
    "half": "with guard:\n guard.drive(1., 1.); time.sleep(9)",
}
for name in ("hup", "quit", "usr1", "alrm"):
    number = f"signal.SIG{name.upper()}"
    BODIES[name] = BODIES["sigterm"].replace("15", number)
HALF = "os.write(1, b'dri'); os.kill(os.getpid(), 15); time.sleep(0.05); os.write(1, b've\\n')"


@pytest.mark.parametrize("way, code", [
    ("exit", 0), ("end", 0), ("sigterm", 143), ("sigint", 1), ("half", 143),
    *[(name, 128 + getattr(signal, f"SIG{name.upper()}"))
      for name in ("hup", "quit", "usr1", "alrm")],
])  # fmt: skip
def test_the_robot_stops_when_the_program_ends(way, code):
    drive = HALF if way == "half" else "self.say('drive')"
    program = PROGRAM.format(path=dntorch.__path__[0], drive=drive, body=BODIES[way])
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    words = done.stdout.split()
    assert words[:2] == ["connect", "drive"], done.stderr
    assert words[2] == "stop" and words[-1] == "close" and {*words[2:]} == {"stop", "close"}
    assert done.returncode in (code, -signal.SIGINT), done.stderr


SUSPENDED = """with guard:
 guard.drive(1.0, 1.0)
 os.kill(os.getpid(), signal.{name})
 guard.drive(1.0, 1.0)
 guard.robot.frame = guard.robot.frame._replace(time=guard.clock.now())
 guard.drive(1.0, 1.0)
"""


@pytest.mark.parametrize("name", ["SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGSTOP"])
def test_a_suspended_robot_stands_and_goes_on_with_a_fresh_image(name):
    say = "self.say('moves' if left else 'stands')"
    program = PROGRAM.format(path=dntorch.__path__[0], drive=say, body=SUSPENDED.format(name=name))
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as process:
        _, status = os.waitpid(process.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status), "it was not suspended"
        before = [process.stdout.readline().strip() for _ in range(2 + (name != "SIGSTOP"))]
        os.kill(process.pid, signal.SIGCONT)
        after = process.stdout.read().split()
    # Of SIGSTOP nobody hears: the deputy of a real link stops the robot meanwhile.
    assert before == ["connect", "moves", "stop"][: len(before)]
    assert after[0] == "stop" and after.index("stands") < after.index("moves"), after
    assert after[-1] == "close" and process.returncode == 0


def test_of_two_signals_in_one_command_none_is_lost():
    drive = "self.say('drive'); [os.kill(os.getpid(), n) for n in (signal.SIGTERM, signal.SIGTSTP)]"
    body = "with guard:\n guard.drive(1., 1.); time.sleep(9)"
    program = PROGRAM.format(path=dntorch.__path__[0], drive=drive, body=body)
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        _, status = os.waitpid(process.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)
        os.kill(process.pid, signal.SIGCONT)
        process.communicate()
    assert process.returncode == 143


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT])
def test_what_the_program_ignores_stays_ignored(number):
    former = signal.signal(number, signal.SIG_IGN)
    try:
        with Bench().guard:
            assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, former)


def test_a_timer_of_the_program_stops_nothing():
    bench, rang = Bench(), []
    former = signal.signal(signal.SIGALRM, lambda *_: rang.append(1))
    try:
        with bench.guard:
            bench.link = bench.server.accept()
            bench.run(1.0)
            signal.raise_signal(signal.SIGALRM)
            bench.wait(0.1)
            assert rang and bench.moves
    finally:
        signal.signal(signal.SIGALRM, former)


def test_without_the_guard_nothing_stops_at_the_end():
    body = BODIES["end"].replace("guard.__enter__(); guard", "Log()")
    program = PROGRAM.format(path=dntorch.__path__[0], drive="self.say('drive')", body=body)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == ["drive"]


def test_signals_belong_to_the_program_again_after_the_block():
    before = [signal.getsignal(number) for number in REQUESTS]
    bench = Bench()
    with bench.guard:
        assert signal.getsignal(signal.SIGTERM) != before[1]
    assert [signal.getsignal(number) for number in REQUESTS] == before
    failed = []

    def elsewhere():  # signals can be watched in the main thread only
        try:
            with Bench().guard:
                pass
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert not failed


def test_the_watchdog_stops_in_real_time():
    class Still:
        connections, age, frame = 1, 0.0, Frame(None, None, None, 0.0, 1)

        def __init__(self):
            self.clock, self.told = RealClock(), []

        def drive(self, left, right):
            self.told.append((self.clock.now(), left))

        def stop(self):
            self.told.append((self.clock.now(), 0.0))

        def connect(self): ...
        def close(self): ...

    robot = Still()
    with Guard(robot, limits=Limits(watchdog=0.3)) as guard:
        guard.drive(1.0, 1.0)
        start = robot.told[0][0]
        guard.clock.sleep_until(start + 1.0)
        assert guard.tripped == "the control loop stalled" and robot.told[1][1] == 0.0
        assert robot.told[1][0] - start < 0.9  # 0.3, and patience with a busy machine
    assert not [thread for thread in threading.enumerate() if "_run" in thread.name]

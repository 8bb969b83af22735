"""How long until a robot stands, whatever happens to its link or to the program that drives it?

An emulated e-puck2 in real time over TCP, which like the real one never stops by itself, and a
program that drives it in a process of its own. Every speed tells the image that it was chosen
for, so that the robot knows how old the images are on which it moves. About 4 minutes; nobody
else should compute meanwhile. The table is that of docs/robot.md.

    python recipes/evidence/stops.py --runs 5
"""

import argparse
import ctypes
import math
import select
import signal
import statistics
import subprocess
import sys
import time

import numpy as np

from dntorch.body import FASTEST, STEPS_PER_TURN
from dntorch.robot.clock import RealClock
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.faults import Faults, Injector
from dntorch.robot.emulated.firmware import WifiFirmware
from dntorch.robot.emulated.servers import TcpServer
from dntorch.robot.safety import Guard, Limits
from dntorch.robot.transports import transport_for

RATE, HELD, CYCLE = 32, 2.0, 900
SIGNALS = [name for name in ("INT", "TERM", "HUP", "QUIT", "USR1", "KILL", "TSTP", "STOP")
           if hasattr(signal, f"SIG{name}")]  # fmt: skip
OWN = ["error", "loop held up", "interpreter held up"]
LINK = {
    "link stalls": Faults(stall=1.0, stall_seconds=HELD),
    "link cut, made anew": Faults(reset=1.0),
    "garbage, link made anew": Faults(garbage=1.0),
}
EVENTS = {name: f"SIG{name}" for name in SIGNALS} | {name: name for name in [*OWN, *LINK]}


def drive(address: str) -> None:
    """The program that drives, until the event that is named on its standard input."""
    driver = Driver(transport_for(address), Wifi(), reconnect=True)
    with Guard(driver, limits=Limits(speed=FASTEST, slew=math.inf)) as guard:
        while True:
            step = 0 if guard.frame is None else int(guard.frame.proximity[0])
            speed = (1 + step % CYCLE) * math.tau / STEPS_PER_TURN
            guard.drive(speed, -speed)
            time.sleep(1 / RATE)
            if select.select([sys.stdin], [], [], 0)[0]:
                event = sys.stdin.readline().strip()
                if event in ("", "error"):  # "": who tells it is no more
                    raise RuntimeError(event)
                held = time.sleep if event == "loop held up" else ctypes.PyDLL(None).sleep
                held(int(HELD))  # PyDLL keeps the interpreter for itself


class World:
    """Wheels turn as told; proximity counts the steps of the world."""

    dt = 1 / RATE

    def __init__(self) -> None:
        self.wheels, self.steps = np.zeros(2), 0

    def move(self, speeds: np.ndarray) -> tuple[float, bool, dict]:
        self.wheels, self.steps = self.wheels + speeds * self.dt, self.steps + 1
        return 0.0, False, {}

    def sense(self, name: str) -> np.ndarray:
        if name == "image":
            return np.zeros((120, 160, 3), np.uint8)
        return self.wheels if name == "wheels" else np.array([self.steps, *7 * [0]])


class Firmware(WifiFirmware):
    """That of an e-puck2; it writes down when it was told to move, on how old an image, or not."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self.world, self.told = world, []

    def _obey(self, data: bytes) -> None:
        super()._obey(data)
        left, _ = self.speeds
        age = (self.world.steps + 1 - left) % CYCLE / RATE if left else None
        self.told.append((time.monotonic(), age))


def happen(event: str) -> tuple[float | None, int, float | None]:
    """s until speed 0, commands of motion until then, s of the oldest image moved on after it."""
    world, server = World(), TcpServer()
    firmware = Firmware(world)
    with Emulator(world, server, firmware, RealClock()) as robot, subprocess.Popen(
        [sys.executable, __file__, "--drive", server.address],
        stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as program:  # fmt: skip
        while sum(age is not None for _, age in firmware.told) < RATE / 2:
            time.sleep(0.01)
        began = time.monotonic()
        if event in LINK:
            robot.faults = Injector(LINK[event])
            time.sleep(2 / RATE)
            robot.faults = Injector(Faults())
        elif event in OWN:
            print(event, file=program.stdin, flush=True)
        else:
            program.send_signal(getattr(signal, f"SIG{event}"))
        time.sleep(HELD)
        if program.poll() is None:
            program.send_signal(signal.SIGCONT)
            time.sleep(HELD)
        program.kill()
        told = [(moment, age) for moment, age in firmware.told if moment > began]
    stood = next((k for k, (_, age) in enumerate(told) if age is None), None)
    if stood is None:
        return None, len(told), None
    later = [age for _, age in told[stood:] if age is not None]
    return told[stood][0] - began, stood, max(later, default=None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--events", nargs="+", choices=EVENTS, default=list(EVENTS))
    parser.add_argument("--drive", help=argparse.SUPPRESS)
    a = parser.parse_args()
    if a.drive:
        drive(a.drive)
    print("| event | s to speed 0: median, longest | commands of motion meanwhile | "
          "oldest image moved on after it, s |\n|---|---|---|---|")  # fmt: skip
    for event in a.events:
        times, commands, ages = zip(*(happen(event) for _ in range(a.runs)))
        stood = [moment for moment in times if moment is not None]
        after = [age for age in ages if age is not None]
        took = f"{statistics.median(stood):.3f}, {max(stood):.3f}" if stood else "never"
        took += "" if len(stood) == a.runs else f", {a.runs - len(stood)} never"
        print(f"| {EVENTS[event]} | {took} | {max(commands)} | "
              f"{f'{max(after):.2f}' if after else 'moved no more'} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()

"""What the tests of robots share: a cheap world, and a robot in it."""

import numpy as np

from dntorch.robot.clock import VirtualClock
from dntorch.robot.dialects import DIALECTS
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.firmware import build_firmware
from dntorch.robot.emulated.servers import MemoryServer

STEPS = 1000 / (2 * np.pi)


class Turntable:
    """A world without physics: wheels turn as told, proximity counts the steps of the world."""

    dt = 1 / 32

    def __init__(self):
        self.speeds, self.wheels, self.steps = [], np.zeros(2), 0
        self.image = np.zeros((120, 160, 3), np.uint8)
        self.image[40:80, 60:100, 2] = 255  # blue, in the middle

    def move(self, speeds):
        self.speeds.append(np.array(speeds))
        self.wheels = self.wheels + self.speeds[-1] * self.dt * STEPS
        self.steps += 1
        return 0.0, False, {"steps": self.steps}

    def sense(self, name):
        count = [self.steps % 4000, self.steps // 4000, 0, 0, 0, 0, 0, 0]
        return {"image": self.image, "wheels": self.wheels, "proximity": np.array(count)}[name]


def number(proximity):
    """The step of the world in which a reading was made."""
    return int(proximity[0] + 4000 * proximity[1])


class Setup:
    """A robot over a link in memory, in virtual time."""

    def __init__(self, protocol="wifi", pacing="firmware", world=None, reconnect=False, **emulator):
        self.clock, self.world = VirtualClock(), world or Turntable()
        self.server = MemoryServer()
        self.emulator = Emulator(
            self.world, self.server, build_firmware(protocol, pacing), self.clock, **emulator
        )
        self.emulator.start()
        self.driver = Driver(
            self.server.transport(), DIALECTS[protocol](), self.clock, reconnect=reconnect
        )

    def wait(self, seconds):
        self.clock.sleep_until(self.clock.now() + seconds)

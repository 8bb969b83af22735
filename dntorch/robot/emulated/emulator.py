"""An e-puck that is not there: a simulated world behind a robot's protocol."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from dntorch.body import EPUCK1_LIMIT, EPUCK2_LIMIT, STEPS_PER_TURN, Body
from dntorch.robot.clock import Clock, RealClock
from dntorch.robot.codecs import wifi
from dntorch.robot.emulated.camera import Camera
from dntorch.robot.emulated.faults import Faults, Injector
from dntorch.robot.emulated.firmware import Firmware
from dntorch.robot.emulated.servers import Link, Server

#: The body of an e-puck2 with its whole image over Wi-Fi; nothing but the motors limits it.
#: fov: 640x480 sensor pixels with a focal length of 941 (cyberbotics/epuck_ros2, camera.yaml).
WIFI_BODY = Body(
    fov=0.656,
    width=wifi.WIDTH,
    height=wifi.HEIGHT,
    speed_cap=EPUCK2_LIMIT * math.tau / STEPS_PER_TURN,
)

#: The body of an e-puck1 over a serial line: 52 columns of 8 sensor pixels each, 416 in all.
SERCOM_BODY = Body(fov=0.435, speed_cap=EPUCK1_LIMIT * math.tau / STEPS_PER_TURN)

#: The same line to an e-puck2, which makes 4 of a zoom of 8: it sees half as much.
SERCOM2_BODY = replace(SERCOM_BODY, fov=0.220, speed_cap=WIFI_BODY.speed_cap)

BODIES = {"wifi": WIFI_BODY, "sercom": SERCOM_BODY, "sercom2": SERCOM2_BODY}

#: Bytes/s of a serial line of 115200 baud.
SERIAL = 11520


class Surroundings(Protocol):
    """What stands around the robot, as an ``EPuckEnv`` that was reset."""

    dt: float

    def move(self, action: np.ndarray) -> tuple[float, bool, dict[str, Any]]:
        """One step under wheel speeds in rad/s; what the world alone knows comes last."""

    def sense(self, name: str) -> np.ndarray:
        """``image``, RGB; ``wheels``, motor steps since the reset; ``proximity``."""


class Emulator:
    """Serves a world to one client at a time, as the firmware would.

    Each ``dt`` of the world it hears the client, moves the world on under the last speed it
    was told, and sends what the protocol wants. Clients may come, go and die: as with the
    real firmware the last speed stays in force. Time goes on whether anyone listens or not.

    Args:
        world: an ``EPuckEnv`` after ``reset``; let its ``body`` have the speed of the motors,
            as `WIFI_BODY` has.
        server: where clients come from.
        firmware: how it talks.
        clock: real time unless you say otherwise.
        camera, faults: what makes it worse than the simulation.
        bandwidth: bytes/s, or ``None`` for no limit; `SERIAL` for a serial line.
        on_step: called after each step of the world with what the world alone knows.

    Attributes:
        steps: steps of the world so far; ``faults.counts``: faults so far.
    """

    def __init__(
        self,
        world: Surroundings,
        server: Server,
        firmware: Firmware,
        clock: Clock | None = None,
        *,
        camera: Camera | None = None,
        faults: Faults | None = None,
        bandwidth: float | None = None,
        on_step: Callable[[dict[str, Any]], None] = lambda info: None,
    ) -> None:
        self.world, self.server, self.firmware = world, server, firmware
        self.clock, self.camera = clock or RealClock(), camera or Camera()
        self.faults, self.bandwidth, self.on_step = Injector(faults or Faults()), bandwidth, on_step
        self.steps, self._images, self._exposed = 0, deque(), 0.0
        self._link: Link | None = None
        self._outbox: deque[tuple[float, bytes]] = deque()
        self._offset, self._ongoing = np.zeros(2, np.int64), None

    @property
    def speeds(self) -> tuple[int, int]:
        """motor steps/s that are in force."""
        return self.firmware.speeds

    @property
    def connected(self) -> bool:
        """Whether there is a client, as far as the robot can tell."""
        return self._link is not None

    def start(self) -> None:
        self._ongoing = self.clock.every(self.world.dt, self.tick)

    def close(self) -> None:
        """Nobody is served any more."""
        if self._ongoing is not None:
            self._ongoing.cancel()
        if self._link is not None:
            self._link.close()
        self.server.close()

    def __enter__(self) -> "Emulator":
        self.start()
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def tick(self) -> None:
        """One step of the world."""
        self._listen()
        speeds = np.array(self.speeds) * (math.tau / STEPS_PER_TURN)
        *_, info = self.world.move(speeds)
        self.steps += 1
        self.on_step(info)
        if self._link is not None:
            self._capture()
            if not self._outbox:
                self._speak()
            self._send()

    # ---------------------------------------------------------------- the link

    def _listen(self) -> None:
        if self._link is None:
            self._link = self.server.accept()
            if self._link is None:
                return
            self.firmware.greet()
        data = self._link.receive()
        if data:
            self.firmware.take(data)
        elif data is None and self.firmware.farewell():
            self._drop()

    def _speak(self) -> None:
        packets = self.firmware.give(self._look, self._feel)
        if not packets:
            return
        plan = self.faults.apply(packets, self.clock.now())
        if plan is None:
            self._drop()
        else:
            self._outbox.extend(plan)

    def _send(self) -> None:
        """What is due, as far as there is room; the robot composes nothing new meanwhile."""
        budget = math.inf if self.bandwidth is None else int(self.bandwidth * self.world.dt)
        try:
            while self._outbox and self._due(self._outbox[0][0]) and budget > 0:
                due, data = self._outbox.popleft()
                part = data if len(data) <= budget else data[: int(budget)]
                sent = self._link.offer(part)
                budget -= sent
                if sent < len(data) and getattr(self.firmware, "pacing", "") != "webots":
                    self._outbox.appendleft((due, data[sent:]))
                    return
        except OSError:
            self.firmware.farewell()
            self._drop()

    def _drop(self) -> None:
        self._link.close()
        self._link = None
        self._outbox.clear()
        self._images.clear()

    # ---------------------------------------------------------------- senses

    def _capture(self) -> None:
        """A new image, if it is time for one; only the newest of those that are ready is kept."""
        now, fps = self.clock.now(), self.camera.fps
        if fps is not None:
            if not self._due(self._exposed):
                return
            self._exposed = max(self._exposed + 1 / fps, now)
        self._images.append((now + self.camera.latency, self.steps, self.world.sense("image")))
        while len(self._images) > 1 and self._due(self._images[1][0]):
            self._images.popleft()

    def _look(self) -> np.ndarray | None:
        """The newest image that is ready, once."""
        while len(self._images) > 1 and self._due(self._images[1][0]):
            self._images.popleft()
        if not self._images or not self._due(self._images[0][0]):
            return None
        _, number, image = self._images.popleft()
        return self.camera.see(image, number)

    def _due(self, moment: float) -> bool:
        return moment <= self.clock.now() + 1e-9

    def _feel(self) -> wifi.Sensors:
        true = np.rint(self.world.sense("wheels")).astype(np.int64)
        if self.firmware.counters is not None:
            self._offset, self.firmware.counters = self.firmware.counters - true, None
        steps = (true + self._offset + 32768) % 65536 - 32768
        proximity = np.rint(self.world.sense("proximity")).astype(int)
        return wifi.Sensors(
            accelerometer=(0, 0, 800), acceleration=800.0, temperature=25, battery=950,
            proximity=tuple(proximity.tolist()), steps=tuple(steps.tolist()), selector=15,
        )  # fmt: skip

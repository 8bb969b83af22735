"""One driver for every e-puck: any transport, any dialect, any clock."""

import math
import threading

import numpy as np

from dntorch.body import STEPS_PER_TURN
from dntorch.robot.clock import Clock, RealClock
from dntorch.robot.codecs import ProtocolError, rgb565
from dntorch.robot.contract import Frame
from dntorch.robot.dialects import Dialect, Reading
from dntorch.robot.transports import LinkLost, Transport

STOPS = 3
"""Commands of speed 0 that make a stop: one may be lost or half."""


class Driver:
    """A `Robot` at the other end of a link.

    A reader in the background keeps only the newest frame. Every command is one ``send``.
    What arrives first after ``gap`` seconds without a byte may be old, since it lay on the
    way meanwhile, and nothing in the protocols tells: that one reading is passed over.
    Bytes that no robot sends, a broken link or long silence end the link: stop commands are
    tried on it, then it is closed. The firmware has no watchdog; see `dntorch.robot.safety`
    for what stops the robot while the link stands.

    Args:
        transport, dialect: the way to the robot and its language.
        clock: real time unless you say otherwise.
        reconnect: make a lost link anew, ``retry`` seconds after each failure. Otherwise
            `drive` raises.
        gap: s without a byte after which one reading is passed over.
        silence: s without a single byte after which a link is lost. Wi-Fi alone stalls for
            up to 6 s.

    Raises:
        LinkLost: from `drive`, if the link is gone and nobody asked to make it anew.
        OSError: from `connect`.
    """

    def __init__(
        self,
        transport: Transport,
        dialect: Dialect,
        clock: Clock | None = None,
        *,
        reconnect: bool = False,
        retry: float = 1.0,
        gap: float = 0.5,
        silence: float = 10.0,
    ) -> None:
        self.transport, self.dialect = transport, dialect
        self.clock = clock or RealClock()
        self.reconnect, self.retry, self.gap, self.silence = reconnect, retry, gap, silence
        self.connections = 0
        self.lost: Exception | None = LinkLost("call connect() first")
        """why there is no link"""
        self._frame: Frame | None = None
        self._number, self._wrapped, self._steps = 0, None, np.zeros(2, np.int64)
        self._sending, self._reader = threading.RLock(), None
        self._heard = self._failed = -math.inf
        self._stalled = False

    # ---------------------------------------------------------------- a robot

    def connect(self) -> None:
        self._open()
        if self._reader is None:
            self._reader = self.clock.background(self.pump)

    @property
    def frame(self) -> Frame | None:
        return self._frame

    @property
    def age(self) -> float:
        frame = self._frame
        return math.inf if frame is None else self.clock.now() - frame.time

    def drive(self, left: float, right: float) -> None:
        if self.lost is not None:
            if not self.reconnect:
                raise LinkLost(f"no link to the robot: {self.lost}") from self.lost
            return
        with self._sending:
            self._say(self._command(left, right))

    def stop(self) -> None:
        for _ in range(STOPS):
            self._say(self.dialect.drive(0, 0))

    def close(self) -> None:
        for _ in range(STOPS):
            self._say(self.dialect.farewell())
        self.lost = self.lost or LinkLost("closed")
        self.reconnect, self._frame = False, None
        if self._reader is not None:
            self._reader.cancel()
            self._reader = None
        self.transport.close()

    # ---------------------------------------------------------------- in the background

    def pump(self) -> None:
        """Read what has come. The reader calls it all the time; it never raises for a link."""
        if self.lost is not None:
            self._try_again()
            return
        try:
            data = self.transport.receive()
            self._listen(bool(data))
            for reading in self.dialect.feed(data):
                self._keep(reading)
        except (OSError, ProtocolError) as error:
            self._lose(error)
            return
        with self._sending:
            self._say(self.dialect.ask())

    def _listen(self, heard: bool) -> None:
        """Watch how long the robot is silent."""
        quiet = self.clock.now() - self._heard
        if heard:
            self._stalled |= quiet > self.gap
            self._heard = self.clock.now()
        elif quiet > self.silence:
            raise LinkLost(f"no byte for {self.silence:g} s")

    def _keep(self, reading: Reading) -> None:
        if self._stalled:
            self._stalled = False
            return
        now = np.array(reading.steps, np.int64)
        if self._wrapped is not None:
            self._steps = self._steps + (now - self._wrapped + 32768) % 65536 - 32768
        self._wrapped, self._number = now, self._number + 1
        image, proximity = rgb565.decode(reading.picture), np.array(reading.proximity, np.float32)
        self._frame = Frame(image, proximity, self._steps, self.clock.now(), self._number)

    # ---------------------------------------------------------------- the link

    def _open(self) -> None:
        self._frame = None
        self.transport.open()
        with self._sending:
            self.transport.send(self.dialect.hello())
            self._heard, self._stalled, self.lost = self.clock.now(), False, None
            self.connections += 1

    def _try_again(self) -> None:
        if not self.reconnect or self.clock.now() - self._failed < self.retry:
            return
        try:
            self._open()
        except OSError as error:
            self._lose(error)

    def _lose(self, error: Exception) -> None:
        """Stop, as far as the link still carries, and close it."""
        with self._sending:
            if self.lost is None:
                self.stop()
            self.lost, self._frame, self._failed = error, None, self.clock.now()
        self.transport.close()

    def _command(self, left: float, right: float) -> bytes:
        limit = self.dialect.limit
        speeds = np.array((left, right)) * (STEPS_PER_TURN / math.tau)
        whole = np.rint(speeds).clip(-limit, limit).astype(int).tolist()
        return self.dialect.drive(*whole) + self.dialect.ask()

    def _say(self, data: bytes) -> None:
        """Send; a failure ends the link."""
        with self._sending:
            if self.lost is not None or not data:
                return
            try:
                self.transport.send(data)
            except OSError as error:
                self.lost, self._frame, self._failed = error, None, self.clock.now()
                self.transport.close()

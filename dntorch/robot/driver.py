"""One driver for every e-puck: any transport, any dialect, any clock."""

import math
import threading

import numpy as np

from dntorch.body import STEPS_PER_TURN
from dntorch.robot.clock import Clock, RealClock
from dntorch.robot.codecs import rgb565
from dntorch.robot.contract import Frame
from dntorch.robot.deputy import Deputy
from dntorch.robot.dialects import Dialect, Reading
from dntorch.robot.link import LinkLost
from dntorch.robot.transports import Transport

STOPS = 3
"""Commands of speed 0 that make a stop: one may be lost or half."""


class Driver:
    """A `Robot` at the other end of a link.

    A reader in the background keeps only the newest frame. Every command is one ``send``.
    What arrives first after ``gap`` seconds without a byte may be old, since it lay on the
    way meanwhile, and nothing in the protocols tells: that one reading is passed over. A reader
    that was itself held up so long, say suspended, passes over all that it finds in the ``gap``
    seconds after that, and one more.
    Bytes that no robot sends, a broken link or long silence end the link: stop commands are
    tried on it, then it is closed. Wheel steps count from the first frame of each link. The
    firmware has no watchdog; see `dntorch.robot.safety` for what stops the robot while the link
    stands, and `watch` for what does when this process can not.

    Args:
        transport, dialect: the way to the robot and its language.
        clock: real time unless you say otherwise.
        reconnect: make a lost link anew, ``retry`` seconds after each failure. Otherwise
            `drive` raises.
        gap: s without a byte, or without the reader, after which readings are passed over.
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
        self._sending, self._reader, self._over = threading.RLock(), None, True
        self._heard = self._failed = self._settled = -math.inf
        self._stalled = False
        self._limit: float | None = None
        self._deputy: Deputy | None = None

    # ---------------------------------------------------------------- a robot

    def connect(self) -> None:
        self._over = False
        try:
            self._open()
        except BaseException:
            self._hang_up()
            raise
        if self._reader is None:
            self._reader = self.clock.background(self.pump)

    def watch(self, limit: float) -> None:
        """From the next link on, a process of its own (`Deputy`) watches over it.

        It stops the robot if this process dies, or if wheels turn and no `drive` comes for
        ``limit`` s. In virtual time, and where the link is none of the operating system, it
        does nothing.
        """
        self._limit = limit

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
        speeds = self._whole(left, right)
        with self._sending:
            # The deputy hears of motion before it begins, of its end when it has ended.
            if any(speeds) and not self._tell(True):
                self._lose(LinkLost("the process that stops the robot has ended"))
            self._say(self.dialect.drive(*speeds) + self.dialect.ask())
            if not any(speeds):
                self._tell(False)

    def stop(self) -> None:
        with self._sending:
            for _ in range(STOPS):
                self._say(self.dialect.drive(0, 0))
            self._tell(False)

    def close(self) -> None:
        self._over = True
        for _ in range(STOPS):
            self._say(self.dialect.farewell())
        self.lost = self.lost or LinkLost("closed")
        self._frame = None
        if self._reader is not None:
            self._reader.cancel()
            self._reader = None
        self._hang_up()

    # ---------------------------------------------------------------- in the background

    def pump(self) -> None:
        """Read what has come. The reader calls it all the time; whatever fails ends the link."""
        try:
            if self.lost is not None:
                self._try_again()
                return
            data = self.transport.receive()
            arrived = self.clock.now()
            if data and self.clock.real:
                arrived = min(arrived, self.transport.arrived)
            self._listen(bool(data), arrived)
            for reading in self.dialect.feed(data, arrived):
                self._keep(reading)
            with self._sending:
                self._say(self.dialect.ask())
        except Exception as error:
            self._lose(error)

    def _listen(self, heard: bool, arrived: float) -> None:
        """Watch how long the robot is silent, and how long nobody has listened."""
        quiet = self.clock.now() - self._heard
        if heard:
            self._heard = self.clock.now()
            self._stalled |= quiet > self.gap
            if self._heard - arrived > self.gap:
                # More of it lies on the way, and nothing tells its end from what is new.
                self._settled = self._heard + self.gap
        elif quiet > self.silence:
            raise LinkLost(f"no byte for {self.silence:g} s")

    def _keep(self, reading: Reading) -> None:
        if self._stalled or self.clock.now() < self._settled:
            self._stalled = self.clock.now() < self._settled
            return
        now = np.array(reading.steps, np.int64)
        if self._wrapped is not None:
            self._steps = self._steps + (now - self._wrapped + 32768) % 65536 - 32768
        self._wrapped, self._number = now, self._number + 1
        image, proximity = rgb565.decode(reading.picture), np.array(reading.proximity, np.float32)
        frame = image, proximity, self._steps, reading.time, self._number
        self._frame = Frame(*frame, self.connections)

    # ---------------------------------------------------------------- the link

    def _open(self) -> None:
        self._hang_up()
        self._frame = None
        self.transport.open()
        with self._sending:
            self.transport.send(self.dialect.hello())
            if self._over:
                raise LinkLost("closed")  # while the link was made anew
            descriptor = self.transport.descriptor if self.clock.real else None
            if self._limit is not None and descriptor is not None:
                stop = STOPS * self.dialect.drive(0, 0)
                self._deputy = Deputy(descriptor, self._limit, stop)
            self._heard, self._stalled, self.lost = self.clock.now(), False, None
            self._wrapped, self._steps = None, np.zeros(2, np.int64)  # maybe of another robot
            self.connections += 1

    def _try_again(self) -> None:
        if self._over or not self.reconnect or self.clock.now() - self._failed < self.retry:
            return
        self._open()

    def _lose(self, error: Exception) -> None:
        """Stop, as far as the link still carries, and close it."""
        with self._sending:
            if self.lost is None:
                self.stop()
            self.lost, self._frame, self._failed = error, None, self.clock.now()
        self._hang_up()

    def _hang_up(self) -> None:
        with self._sending:  # or another thread might still speak to the deputy
            deputy, self._deputy = self._deputy, None
            if deputy is not None:
                deputy.dismiss()
            self.transport.close()

    def _whole(self, left: float, right: float) -> list[int]:
        """Motor steps/s, as far as the motors follow."""
        limit = self.dialect.limit
        speeds = np.array((left, right)) * (STEPS_PER_TURN / math.tau)
        return np.rint(speeds).clip(-limit, limit).astype(int).tolist()

    def _tell(self, moves: bool) -> bool:
        """Whether the deputy has heard, if there is one."""
        return self._deputy is None or self._deputy.hear(moves)

    def _say(self, data: bytes) -> None:
        """Send; a failure ends the link."""
        with self._sending:
            if self.lost is not None or not data:
                return
            try:
                self.transport.send(data)
            except OSError as error:
                self.lost, self._frame, self._failed = error, None, self.clock.now()
                self._hang_up()

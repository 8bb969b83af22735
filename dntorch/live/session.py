"""A structure that is stepped while somebody looks at it and turns its knobs."""

import threading
import time
from collections import deque
from collections.abc import Sequence

import numpy as np
import torch

from dntorch.live.by_hand import ByHand
from dntorch.live.inputs import Peak
from dntorch.live.knobs import Knob
from dntorch.live.pictures import ROWS, Picture, picture_of, profile
from dntorch.live.sources import Source
from dntorch.live.watched import Watched

BUDGET = 0.015
"""Seconds of stepping at most between two looks at what the user does."""
BEHIND = 0.25
"""Seconds of delay that are made up for; a structure slower than wanted does not pile up more."""
FINE = 0.005
"""Seconds per step up to which time passes slowly at first: such models live in milliseconds."""


class Session:
    """Steps a `Source`: play, pause, step, reset, and changes between two steps.

    Every method may be called from any thread: one lock makes a step, a change and a picture
    follow each other.

    Args:
        source: what is stepped.

    Attributes:
        speed: simulated seconds per second, ``inf`` for as fast as it goes.
        steps: steps since the last reset.
        version: changes whenever there is something new to draw.
        turned: changes whenever a knob was turned, or an input put or taken away.
        trouble: a sentence; why it stopped by itself, or "".
    """

    def __init__(self, source: Source) -> None:
        self.source, self.lock = source, threading.RLock()
        self.playing, self.steps, self.version = False, 0, 0
        self.speed = 1.0 if source.dt > FINE else 1 / 16
        self.turned, self.trouble, self.pace = 0, "", 0.0
        self._put = ByHand(source.parts)
        self._due, self._last = 0.0, time.monotonic()
        self._taken, self._since = 0, time.monotonic()
        self._shown = list(source.shown)
        self._trails: dict[str, deque[np.ndarray]] = {}
        self._note_trails()

    # ------------------------------------------------------------------ running

    def play(self) -> None:
        with self.lock:
            self.playing, self._due, self._last, self.trouble = True, 0.0, time.monotonic(), ""
            self._taken, self._since = self.steps, self._last
            self.version += 1

    def pause(self) -> None:
        with self.lock:
            self.playing, self.pace = False, 0.0
            self.version += 1

    def toggle(self) -> None:
        self.pause() if self.playing else self.play()

    def step(self, count: int = 1) -> None:
        """Steps, now."""
        with self.lock:
            for _ in range(count):
                self._step()

    @torch.inference_mode()
    def _step(self) -> None:
        self.source.advance()
        self.steps += 1
        self.version += 1
        self._note_trails()

    def tick(self) -> None:
        """The steps that are due by now, as far as a moment allows; called again and again.

        A step that fails stops it: ``trouble`` says why.
        """
        with self.lock:
            if not self.playing:
                return
            now, dt = time.monotonic(), self.source.dt
            self._due = min(self._due + (now - self._last) * self.speed, max(BEHIND, dt))
            if self.speed == np.inf:
                self._due = np.inf
            self._last = now
            try:
                while self._due >= dt and time.monotonic() - now < BUDGET:
                    self._step()
                    self._due -= dt
            except (ValueError, RuntimeError) as error:
                self.playing, self.trouble = False, " ".join(str(error).split())
                self.version += 1
            if now - self._since > 1:
                self.pace = (self.steps - self._taken) * dt / (now - self._since)
                self._taken, self._since = self.steps, now

    def reset(self) -> None:
        """Back to rest. Parameters, inputs put by hand and what was learned stay."""
        with self.lock, torch.inference_mode():
            self.source.reset()
            self.steps, self.trouble = 0, ""
            self._trails.clear()
            self._note_trails()
            self.version += 1

    def set_speed(self, speed: float) -> None:
        if not speed > 0:
            raise ValueError(f"speed={speed} must be positive: pause instead")
        with self.lock:
            self.speed, self._due = float(speed), 0.0
            self.version += 1

    @property
    def time(self) -> float:
        """Simulated seconds since the last reset."""
        return self.steps * self.source.dt

    # ------------------------------------------------------------------ changes

    def knobs(self) -> dict[str, list[Knob]]:
        """What can be turned, by group: of elements and links, and of inputs put by hand."""
        with self.lock:
            groups: dict[str, list[Knob]] = {}
            for knob in self.source.knobs:
                groups.setdefault(knob.group, []).append(knob)
            for name in self.peaks:
                groups[name] = self._put.knobs(name)
            return groups

    def get(self, group: str, name: str) -> float:
        with self.lock:
            return self._knob(group, name).read()

    def set(self, group: str, name: str, value: float) -> None:
        """Turn a knob.

        Raises:
            ValueError: there is no such knob, or the structure refuses the value; nothing changes.
        """
        self.turn(self._knob(group, name), value)

    def turn(self, knob: Knob, value: float) -> None:
        """The same for a knob of `knobs`."""
        with self.lock:
            try:
                knob.write(float(value))
            finally:
                self._changed()

    def _changed(self) -> None:
        self.version += 1
        self.turned += 1

    def _knob(self, group: str, name: str) -> Knob:
        for knob in self.knobs().get(group, []):
            if knob.name == name:
                return knob
        raise ValueError(f"{group!r} has no {name!r}: choose from knobs()")

    def touch(self, label: str, position: Sequence[float] = ()) -> str | None:
        """Put an input at a place of a part, or take away the one that is there.

        Returns:
            its name, or None if one was taken away.

        Raises:
            ValueError: no such part, or a place that is none in it.
        """
        with self.lock:
            part = self._part(label)
            self._changed()
            return self._put.touch(part, position)

    def clear(self) -> None:
        """Take away all inputs that were put by hand."""
        with self.lock:
            self._put.clear()
            self._changed()

    @property
    def peaks(self) -> dict[str, tuple[str, Peak]]:
        """Inputs put by hand, by name: where, and what."""
        return self._put.peaks

    def _part(self, label: str) -> Watched:
        if label not in self.source.parts:
            raise ValueError(f"label={label!r} is not there: choose from {list(self.source.parts)}")
        return self.source.parts[label]

    def reward(self) -> None:
        """Give the reward by hand."""
        with self.lock:
            self.source.reward()
            self.version += 1

    def learn(self, on: bool) -> None:
        with self.lock:
            self.source.learn(on)

    # ------------------------------------------------------------------ pictures

    @property
    def shown(self) -> list[str]:
        """Parts that are drawn."""
        return list(self._shown)

    @shown.setter
    def shown(self, labels: Sequence[str]) -> None:
        with self.lock, torch.inference_mode():
            for label in labels:
                self._part(label)
            self._shown = list(labels)
            self._note_trails(only_new=True)
            self.version += 1

    def _note_trails(self, only_new: bool = False) -> None:
        for label in self._shown:
            if not (only_new and label in self._trails):
                trail = self._trails.setdefault(label, deque(maxlen=ROWS))
                trail.append(profile(self.source.parts[label].activation()))
        for label in self._trails.keys() - set(self._shown):
            del self._trails[label]

    @torch.inference_mode()
    def pictures(self) -> dict[str, Picture]:
        """The parts that are shown, as they are now."""
        with self.lock:
            return {label: self._picture(label) for label in self._shown}

    def _picture(self, label: str) -> Picture:
        return picture_of(self.source.parts[label], self._trails[label])

    @torch.inference_mode()
    def images(self) -> dict[str, np.ndarray]:
        with self.lock:
            return self.source.images()

    @torch.inference_mode()
    def matrices(self) -> dict[str, np.ndarray]:
        with self.lock:
            return {k: np.array(v, np.float32) for k, v in self.source.matrices().items()}

    @torch.inference_mode()
    def note(self) -> str:
        with self.lock:
            return self.trouble or self.source.note()

    def close(self) -> None:
        with self.lock:
            self.playing = False
            self.source.close()

"""What a page draws, as numbers: one message per picture, a byte per site of a heat map."""

import json
import math
from typing import Any

import numpy as np

from dntorch.live.pictures import ROWS, Picture
from dntorch.live.session import Session

LEVELS = 255
"""colours of a heat map; the byte above them is for what is not a number"""
WIDEST = 250
"""pixels of an image at most, about"""


class Scale:
    """A range of values that grows with them, in few steps."""

    def __init__(self, least: float = 1.0, low: float = math.inf, high: float = -math.inf) -> None:
        self.least, self.low, self.high = least, low, high

    def fit(self, *arrays: np.ndarray) -> tuple[float, float]:
        known = [array[np.isfinite(array)] for array in arrays]
        known = [array for array in known if array.size]
        if not known:
            return (self.low, self.high) if self.low < self.high else (0.0, 1.0)
        low, high = min(float(x.min()) for x in known), max(float(x.max()) for x in known)
        if low < self.low or high > self.high:
            low, high = min(low, self.low), max(high, self.high)
            unit = 10.0 ** math.floor(math.log10(max(high - low, self.least))) / 2
            self.low, self.high = unit * math.floor(low / unit), unit * math.ceil(high / unit)
            if self.high <= self.low:
                self.high = self.low + self.least
        return self.low, self.high


class Drawing:
    """Encodes what a session shows; remembers the ranges of values."""

    def __init__(self) -> None:
        self.scales: dict[tuple[str, str], Scale] = {}

    def rescale(self) -> None:
        """Begin anew with the ranges of values."""
        self.scales.clear()

    def encode(self, session: Session) -> tuple[str, np.ndarray]:
        """A description, JSON, and the bytes it describes."""
        with session.lock:
            pictures, images, matrices = session.pictures(), session.images(), session.matrices()
            described: dict[str, Any] = {
                "time": session.time, "playing": session.playing, "pace": session.pace,
                "note": session.note(),
            }  # fmt: skip
        rows, parts = [], []
        extras = [self._image(*each, parts) for each in images.items()]
        extras += [self._map(title, x, parts, least=0.01) for title, x in matrices.items()]
        if extras:
            rows.append({"label": "", "panels": extras})
        for label, picture in pictures.items():
            rows.append({"label": label, "panels": self._part(label, picture, parts)})
        for panel in (panel for row in rows for panel in row["panels"]):
            panel["letters"] = session.source.letters.get(panel["title"], "")
        described["rows"] = rows
        return json.dumps(described), np.concatenate(parts)

    def _part(self, label: str, picture: Picture, parts: list[np.ndarray]) -> list[dict[str, Any]]:
        """Panels of one part, their bytes in the same order."""
        if picture.activation.ndim == 0:
            return [self._lines(label, _history(picture), parts) | {"touch": 0, "steps": True}]
        if picture.activation.ndim == 1:
            panels = [self._lines(label, picture, parts) | {"touch": 1}]
        else:
            names = (f"{label}: activation", "output", "input")
            panels = [
                self._map(name, x, parts, label) | {"touch": 2} for name, x in zip(names, picture)
            ]
        trail = self._map("space-time: activation", picture.trail, parts, label, steps=True)
        return [*panels, trail]

    def _scale(self, *key: str, least: float = 1.0) -> Scale:
        return self.scales.setdefault(key, Scale(least))

    def _lines(self, label: str, picture: Picture, parts: list[np.ndarray]) -> dict[str, Any]:
        values = self._scale(label, "values").fit(picture.activation, picture.input)
        rates = self._scale(label, "rates").fit(picture.output, np.array([0.0, 1.0]))
        for array in picture[:3]:
            parts.append(np.frombuffer(array.astype("<f4").tobytes(), np.uint8))
        return {
            "kind": "lines", "title": label, "n": picture.activation.size,
            "values": values, "rates": rates,
        }  # fmt: skip

    def _map(
        self, title: str, array: np.ndarray, parts: list[np.ndarray], label: str = "",
        least: float = 1.0, steps: bool = False,
    ) -> dict[str, Any]:  # fmt: skip
        low, high = self._scale(label, title, least=least).fit(array)
        parts.append(as_bytes(array, low, high).reshape(-1))
        return {
            "kind": "map", "title": title, "shape": array.shape, "values": (low, high),
            "steps": steps,
        }  # fmt: skip

    def _image(self, title: str, image: np.ndarray, parts: list[np.ndarray]) -> dict[str, Any]:
        stride = math.ceil(image.shape[1] / WIDEST)
        small = np.ascontiguousarray(image[::stride, ::stride], dtype=np.uint8)
        parts.append(small.reshape(-1))
        return {"kind": "image", "title": title, "shape": small.shape[:2]}


def as_bytes(array: np.ndarray, low: float, high: float) -> np.ndarray:
    """The level of each number between ``low`` and ``high``; `LEVELS` for what is none."""
    with np.errstate(invalid="ignore"):
        level = (array - low) * ((LEVELS - 1) / (high - low))
    return np.where(np.isnan(level), LEVELS, level.clip(0, LEVELS - 1)).astype(np.uint8)


def _history(picture: Picture) -> Picture:
    """The last steps of a node; output and input as they are now."""
    flat = np.ones(ROWS, np.float32)
    return Picture(picture.trail[:, 0], picture.output * flat, picture.input * flat, picture.trail)

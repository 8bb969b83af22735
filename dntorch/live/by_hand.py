"""Inputs that somebody puts into parts by hand."""

from collections.abc import Mapping, Sequence

from dntorch.live.inputs import Peak, peak_for
from dntorch.live.knobs import Knob, peak_knobs
from dntorch.live.watched import Watched


class ByHand:
    """Peaks, by name; what is added to a part is their sum.

    Attributes:
        peaks: for each name the label of a part, and the peak.
    """

    def __init__(self, parts: Mapping[str, Watched]) -> None:
        self.parts = parts
        self.peaks: dict[str, tuple[str, Peak]] = {}
        self._count = 0

    def touch(self, part: Watched, position: Sequence[float]) -> str | None:
        """Put one at a place and give its name, or take away the one that is there."""
        place = _place(part, position)
        for name, (label, peak) in self.peaks.items():
            if label == part.label and peak.holds(place):
                del self.peaks[name]
                self._apply(part)
                return None
        self._count += 1
        name = f"input {self._count} ({part.label})"
        self.peaks[name] = part.label, peak_for(part.part, part.shape, place)
        self._apply(part)
        return name

    def clear(self) -> None:
        self.peaks.clear()
        for part in self.parts.values():
            self._apply(part)

    def knobs(self, name: str) -> list[Knob]:
        """Position, width and amplitude of one."""

        def write(peak: Peak) -> None:
            peak.tensor()  # may refuse
            label, _ = self.peaks[name]
            self.peaks[name] = label, peak
            self._apply(self.parts[label])

        return peak_knobs(name, lambda: self.peaks[name][1], write)

    def _apply(self, part: Watched) -> None:
        peaks = [peak.tensor() for label, peak in self.peaks.values() if label == part.label]
        part.added = sum(peaks[1:], peaks[0]) if peaks else None


def _place(part: Watched, position: Sequence[float]) -> list[float]:
    """A place in a part; in one of three axes, which is seen along the first, where it is most
    active."""
    place = [float(x) for x in position]
    if len(part.shape) == 3 and len(place) == 2:
        place = [float(part.activation().amax((-1, -2)).argmax()), *place]
    inside = all(-0.5 <= x <= n - 0.5 for x, n in zip(place, part.shape))
    if len(place) != len(part.shape) or not inside:
        raise ValueError(
            f"position={list(position)} is no place in {part.label!r} of shape {part.shape}: "
            "give a site for each axis, from 0"
        )
    return [min(max(x, 0.0), n - 1.0) for x, n in zip(place, part.shape)]

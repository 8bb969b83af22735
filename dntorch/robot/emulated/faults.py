"""What can go wrong with a link, at random but the same for the same seed."""

from collections import Counter
from dataclasses import dataclass, fields

import numpy as np

from dntorch.quantities import Interval


@dataclass(frozen=True)
class Faults:
    """Probability of each fault for each set of packets that a robot sends.

    Raises:
        ValueError: probabilities that are none, or together above 1; seconds below 0.
    """

    stall: float = 0.0
    """nothing is sent for ``stall_seconds``, then it goes on in the middle"""
    delay: float = 0.0
    """sent up to ``delay_seconds`` late"""
    drop: float = 0.0
    """one packet of the set is left out"""
    truncate: float = 0.0
    """the end of one packet is missing"""
    split: float = 0.0
    """sent in pieces, 0.01 s apart"""
    duplicate: float = 0.0
    """sent twice"""
    garbage: float = 0.0
    """bytes before it that no robot sends"""
    reset: float = 0.0
    """the connection breaks"""
    stall_seconds: float = 6.0
    delay_seconds: float = 0.3
    seed: int = 0

    def __post_init__(self) -> None:
        for name, chance in self.chances.items():
            Interval(0, 1).check(name, chance)
        if (total := sum(self.chances.values())) > 1:
            given = ", ".join(f"{name}={chance}" for name, chance in self.chances.items() if chance)
            raise ValueError(f"{given}: give probabilities that sum to at most 1, not {total:g}")
        for name in ("stall_seconds", "delay_seconds"):
            Interval(0, 3600, unit="s").check(name, getattr(self, name))

    @property
    def chances(self) -> dict[str, float]:
        names = [field.name for field in fields(self)]
        return {name: getattr(self, name) for name in names[: names.index("stall_seconds")]}


class Injector:
    """Applies faults to sets of packets.

    Attributes:
        counts: how often each fault was applied.
    """

    def __init__(self, faults: Faults) -> None:
        self.faults, self.random = faults, np.random.default_rng(faults.seed)
        self.counts: Counter[str] = Counter()

    def apply(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]] | None:
        """When to send which bytes; ``None`` breaks the connection."""
        fault = self._draw()
        self.counts[fault] += 1
        if fault == "reset":
            return None
        act = getattr(self, "_" + fault, None)
        return act(packets, now) if act else [(now, b"".join(packets))]

    def _draw(self) -> str:
        at = self.random.random()
        for name, chance in self.faults.chances.items():
            at -= chance
            if at < 0:
                return name
        return "none"

    def _cut(self, data: bytes) -> int:
        return int(self.random.integers(len(data)))

    def _stall(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        data = b"".join(packets)
        at = self._cut(data)
        return [(now, data[:at]), (now + self.faults.stall_seconds, data[at:])]

    def _delay(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        late = self.random.random() * self.faults.delay_seconds
        return [(now + late, b"".join(packets))]

    def _drop(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        gone = int(self.random.integers(len(packets)))
        return [(now, data) for at, data in enumerate(packets) if at != gone]

    def _truncate(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        cut = int(self.random.integers(len(packets)))
        ends = [self._cut(data) if at == cut else len(data) for at, data in enumerate(packets)]
        return [(now, data[:end]) for data, end in zip(packets, ends)]

    def _split(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        data = b"".join(packets)
        cuts = [0, *sorted(self._cut(data) for _ in range(5)), len(data)]
        return [(now + 0.01 * k, data[a:b]) for k, (a, b) in enumerate(zip(cuts, cuts[1:]))]

    def _duplicate(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        return [(now, 2 * b"".join(packets))]

    def _garbage(self, packets: list[bytes], now: float) -> list[tuple[float, bytes]]:
        noise = bytes([int(self.random.integers(4, 256))]) + self.random.bytes(self._cut(bytes(64)))
        return [(now, noise + b"".join(packets))]

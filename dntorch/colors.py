"""The colours a behaviour can look for: one letter, one hue.

Letters are the public names of colours everywhere: ``"GBYRG"`` is a sequence,
``"RGBY"`` a repertoire whose positions are the indices of behaviours.
"""

from __future__ import annotations

from dntorch.quantities import shown

#: Hue in degrees on the HSV circle.
HUES: dict[str, float] = {
    "R": 0.0, "O": 30.0, "Y": 60.0, "G": 120.0,
    "C": 180.0, "B": 240.0, "V": 270.0, "M": 300.0,
}  # fmt: skip

NAMES: dict[str, str] = {
    "R": "red", "O": "orange", "Y": "yellow", "G": "green",
    "C": "cyan", "B": "blue", "V": "violet", "M": "magenta",
}  # fmt: skip

#: Saturation and value, 0 to 1, below which a pixel has no colour: too gray, too dark.
MIN_SATURATION, MIN_VALUE = 90 / 255, 40 / 255

#: The four colours of the paper, in the order of its figure.
PAPER = "RGBY"

#: The rewarded sequence of the paper.
SEQUENCE = "GBYRG"

#: Size of the reward signal for it, and its length in s, unless a run says otherwise.
REWARD, REWARD_DURATION = 2.0, 1.0


def check_colors(colors: str) -> str:
    """Return ``colors`` if it is a repertoire: two or more known letters, none twice."""
    _check_text("colors", colors)
    unknown = [letter for letter in colors if letter not in HUES]
    if unknown:
        raise ValueError(
            f"colors={colors!r} has the unknown letter {unknown[0]!r}: choose from {''.join(HUES)}"
        )
    if len(colors) < 2 or len(set(colors)) < len(colors):
        raise ValueError(f"colors={colors!r}: give two or more different letters, as {PAPER!r}")
    return colors


def check_sequence(sequence: str, colors: str, name: str = "sequence") -> str:
    """Return ``sequence`` if behaviours that find ``colors`` can execute it.

    A behaviour never follows itself (it is finished: its condition of satisfaction
    inhibits it), so a letter may return but not at once. ``name`` is what to call it.
    """
    _check_text(name, sequence)
    missing = [letter for letter in sequence if letter not in colors]
    if missing:
        raise ValueError(
            f"{name}={sequence!r} has the letter {missing[0]!r}, which colors={colors!r} lacks: "
            "use letters of colors"
        )
    if len(sequence) < 2:
        raise ValueError(f"{name}={sequence!r} is too short: give at least two letters")
    for first, second in zip(sequence, sequence[1:]):
        if first == second:
            raise ValueError(
                f"{name}={sequence!r} repeats {first!r} at once: a behaviour cannot follow "
                "itself, put another letter between"
            )
    return sequence


def check_missing(missing: str, colors: str = "".join(HUES)) -> str:
    """Return ``missing`` if it names some of ``colors``, none twice, and leaves two or more."""
    letters = missing if isinstance(missing, str) else "?"
    left = set(colors) - set(letters)
    if set(letters) - set(colors) or len(set(letters)) < len(letters) or len(left) < 2:
        raise ValueError(
            f"missing={shown(missing)}: give different letters of colors={colors!r} that leave "
            "at least two, or ''"
        )
    return missing


def _check_text(name: str, value: str) -> None:
    if not isinstance(value, str):
        raise ValueError(f"{name}={shown(value)} is no text: give letters, as {PAPER!r}")


def indices(sequence: str, colors: str) -> list[int]:
    """Positions of the letters of ``sequence`` in ``colors``."""
    return [colors.index(letter) for letter in check_sequence(sequence, check_colors(colors))]

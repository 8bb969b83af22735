"""One run, as numbers: which world, which task, how long, with which parameters.

Imports no PyTorch: the command line makes its options of these fields.
"""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from dntorch.body import EPUCK
from dntorch.cells.integrators import INTEGRATORS, check_integrator
from dntorch.colors import (
    HUES,
    PAPER,
    REWARD,
    REWARD_DURATION,
    SEQUENCE,
    check_colors,
    check_missing,
    check_sequence,
)
from dntorch.quantities import Interval, shown
from dntorch.runs.worlds import WORLDS


def _setting(
    default: Any, text: str, choices: tuple[str, ...] = (), within: Interval | None = None
) -> Any:
    """A field: its default, what it is in the words of ``--help``, and what it may be."""
    metadata = {"help": text, "choices": choices, "within": within}
    return field(default=default, metadata=metadata)


def _whole(least: int, most: int) -> Interval:
    return Interval(least, most, whole=True)


def _above_zero(most: float) -> Interval:
    return Interval(0, most, above=True)


LONGEST = 10_000_000
"""Control steps of a run at most: three and a half days at 32 a second, of which everything is
remembered."""
LONGEST_TEXT = 64
"""Of a sequence, at most."""

TEXT = "; ".join(f"{name}: {row.text}" for name, row in WORLDS.items()) + "."


@dataclass(frozen=True)
class Config:
    """What a run depends on; the same config gives the same numbers.

    Numbers are finite and lie within the limits that ``within`` states for each, here and in
    ``FIELDS[name].metadata``: wherever they come from, the command line, a file, a checkpoint.

    Raises:
        ValueError: a value that makes no run; the sentence says what to give.
    """

    world: str = _setting("epuck", TEXT, tuple(WORLDS))
    seed: int = _setting(0, "Of layout, exploration and durations.", within=_whole(0, 2**32 - 1))
    explore: int = _setting(
        50_000, "Control steps of exploration; half of a shorter run.", within=_whole(0, LONGEST)
    )
    steps: int = _setting(
        100_000, "Control steps in all; the rest is exploitation.", within=_whole(1, LONGEST)
    )
    sequence: str = _setting(SEQUENCE, "Colours that are rewarded in this order.")
    colors: str = _setting(PAPER, f"Colours to look for, of {''.join(HUES)}.")
    dt: float = _setting(1 / 32, "Duration of a control step, s.", within=Interval(0.001, 1))
    substeps: int = _setting(1, "Integrator steps per control step.", within=_whole(1, 100))
    integrator: str = _setting("euler", "Of the neural dynamics.", INTEGRATORS)
    learning_rate: float = _setting(0.06, "Of the values, 1/s.", within=_above_zero(100))
    trace_tau: float = _setting(
        1.0, "Time constant of the item-and-order memory, s.", within=_above_zero(3600)
    )
    pulse_tau: float = _setting(
        0.5, "Time constant of the transient pulse cells, s.", within=_above_zero(3600)
    )
    reward: float = _setting(REWARD, "Size of the reward signal.", within=Interval(-1000, 1000))
    reward_duration: float = _setting(
        REWARD_DURATION, "Length of the reward signal, s.", within=_above_zero(3600)
    )
    noise: float = _setting(
        10.0, "Amplitude of exploration on the values.", within=_above_zero(1000)
    )
    dwell: float = _setting(
        0.5, "Seconds of rest before a block that find it, in worlds seen.", within=_above_zero(60)
    )
    recall: int = _setting(
        0, "How many completions before the last belong to the state.", within=_whole(0, 3)
    )
    habituation: int = _setting(
        -1,
        "Exploration prefers what is fresh after this many completions; -1: it does not.",
        within=_whole(-1, 8),
    )
    recovery: float = _setting(
        1200.0,
        "Time constant with which a behaviour becomes fresh again (--habituation), s.",
        within=_above_zero(1e6),
    )
    patience: float = _setting(
        0.0,
        "Seconds after which an intention without success is given up; 0: never.",
        within=Interval(0, 3600),
    )
    constraints: float = _setting(
        0.0,
        "Learning rate of constraints, what failed after what, 1/s; 0: no constraints.",
        within=Interval(0, 30),
    )
    curiosity: float = _setting(
        0.0,
        "Size of the intrinsic reward of a lamp that shows progress; 0: no lamp.",
        within=Interval(0, 100),
    )
    then: str = _setting("", "Another sequence, which is rewarded from step --change on.")
    change: int = _setting(0, "Control step of that change; 0: none.", within=_whole(0, LONGEST))
    missing: str = _setting("", "Colours that are nowhere in the world.")
    width: int = _setting(EPUCK.width, "Columns of the camera image.", within=_whole(8, 640))
    height: int = _setting(EPUCK.height, "Rows of the camera image.", within=_whole(6, 480))

    def __post_init__(self) -> None:
        from dntorch.checks import check_time_constant  # imports PyTorch

        for each in fields(self):
            check_setting(each.name, getattr(self, each.name))
        check_sequence(self.sequence, check_colors(self.colors))
        check_integrator(self.integrator, self.substeps)
        if self.reward_duration < self.dt:
            raise ValueError(
                f"reward_duration={self.reward_duration} is shorter than a control step: give at "
                f"least dt={self.dt}"
            )
        for name in ("trace_tau", "pulse_tau", "recovery"):
            check_time_constant(name, getattr(self, name), self.fine)
        if self.patience:
            check_time_constant("patience", self.patience, self.fine)
        self._check_together()
        if self.explore > self.steps:
            raise ValueError(
                f"explore={self.explore} is not within steps={self.steps}: explore for fewer steps "
                "or run for more"
            )

    def _check_together(self) -> None:
        if bool(self.then) != bool(self.change):
            raise ValueError(
                f"then={self.then!r} with change={self.change}: give both, the sequence and the "
                "step from which on it is rewarded, or none"
            )
        if self.then:
            check_sequence(self.then, self.colors, "then")
            if len(self.then) != len(self.sequence):
                raise ValueError(
                    f"then={self.then}: give a sequence as long as sequence={self.sequence}"
                )
        if self.change >= self.steps:
            raise ValueError(f"change={self.change}: give a step before steps={self.steps}")
        if self.recovery != FIELDS["recovery"].default and self.habituation < 0:
            raise ValueError(f"recovery={self.recovery} of no habituation: give habituation, too")
        check_missing(self.missing, self.colors)
        if self.constraints and not self.patience:
            raise ValueError(
                f"constraints={self.constraints} learn from failures: give patience, such as "
                "patience=20"
            )

    @property
    def lifelong(self) -> bool:
        """Whether an agent has no phases: it explores to the end, and gives up what is in vain."""
        return self.patience > 0 and self.explore == self.steps

    @property
    def fine(self) -> float:
        """Seconds an integrator step."""
        return self.dt / self.substeps


def check_setting(name: str, value: Any, label: str | None = None) -> None:
    """Raise a ``ValueError`` unless a field of `Config`, by itself, may have this value.

    Args:
        label: what to call it, if not by its name.
    """
    metadata, label = FIELDS[name].metadata, label or name
    if metadata["within"] is not None:
        metadata["within"].check(label, value)
    elif metadata["choices"]:
        if value not in metadata["choices"]:
            choices = ", ".join(metadata["choices"])
            raise ValueError(f"{label}={shown(value)} is unknown: choose from {choices}")
    elif not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError(f"{label}={shown(value)}: give a text of at most {LONGEST_TEXT} letters")


def kept_config(values: Any, path: Path) -> Config:
    """The config that a file of ours at ``path`` holds.

    Raises:
        ValueError: it holds none, or one that makes no run.
    """
    try:
        return Config(**values)
    except TypeError as error:
        raise ValueError(f"{path} is of another version of dntorch: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path} cannot be used: {error}") from error


AUTONOMOUS: dict[str, Any] = {
    "noise": 0.2, "learning_rate": 0.2, "habituation": 4, "patience": 20.0, "constraints": 20.0
}  # fmt: skip
"""One set of numbers for an agent without phases: small noise all its life, which yields to what
was learned and prefers what is fresh; an end to what is in vain, which is remembered."""

FIELDS = {each.name: each for each in fields(Config)}
"""Of a config, by name."""

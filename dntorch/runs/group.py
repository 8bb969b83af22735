"""Which agents run in one batch."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from dntorch.runs.config import Config


@dataclass(frozen=True)
class Group:
    """Which agents run, and what they share.

    ``parameters`` gives each agent a value of its own: the path of a number within the agent
    (``"learner.values.learning_rate"``), or ``"reward"``, ``"reward_duration"``, ``"noise"``.
    """

    config: Config
    agents: tuple[int, ...]
    variant: str = ""
    learns_in_exploitation: bool = True
    parameters: dict[str, tuple[float, ...]] = field(default_factory=dict)
    tasks: tuple[str, ...] = ()
    """rewarded sequences beside that of ``config``"""
    shown: int = 0
    """how often exploration is led through the sequence, at random times"""
    keep_weights: bool = True
    """remember the weights at every onset"""
    rows: tuple[int, ...] = ()
    """what to call each agent in the events, by default its number"""

    def description(self) -> str:
        """All of it in one line, which finished and begun runs keep."""
        return json.dumps(asdict(self), sort_keys=True)

    def check(self, description: str, path: Path) -> None:
        """Raise unless the runs kept at ``path`` are those of this group."""
        if description != self.description():
            raise ValueError(f"{path} is of another group of runs: name another folder")

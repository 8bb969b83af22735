"""Scalars of a run for TorchRL's loggers, while it runs."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dntorch.runs.run import Trial

LOGGERS = ("csv", "tensorboard")


def open_log(kind: str, folder: Path) -> "Callable[[Trial], None]":
    """A function that logs where a trial stands, by control step, below ``folder/log``.

    =================  ===========================================================
    scalar             meaning
    =================  ===========================================================
    ``behaviors``      found so far
    ``rewards``        completed sequences so far
    ``disagreements``  of the agent's reports with the world so far
    ``largest_value``  of the learned values
    ``error``          value cell, now
    =================  ===========================================================
    """
    try:
        from torchrl.record.loggers import get_logger

        logger = get_logger(kind, str(folder), "log")
    except ImportError as error:
        raise ImportError(f"--log {kind}: {error}: run pip install 'dntorch[rl]'") from error

    def log(trial: "Trial") -> None:
        record = trial.record
        scalars = {
            "behaviors": len(record.behaviors),
            "rewards": len(record.rewards),
            "disagreements": record.disagreements,
            "largest_value": float(trial.agent.weights.max()),
            "error": float(record.error[trial.step - 1]),
        }
        for name, value in scalars.items():
            logger.log_scalar(name, value, step=trial.step)

    return log

"""A small run to look at."""

from pathlib import Path

from dntorch.runs.config import Config
from dntorch.runs.run import Trial


def write_run(folder: Path, world: str = "nodes", steps: int = 60) -> Path:
    trial = Trial(Config(world=world, steps=steps, explore=steps))
    trial.advance(steps)
    trial.save(folder / "checkpoint.pt")
    trial.close()
    return folder

"""The learning command: train one agent, keep checkpoints, write down what happened."""

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import dntorch
from dntorch.envs.task import SequenceTask
from dntorch.files import write_atomically, write_json
from dntorch.process import postponed
from dntorch.runs.trial import Trial

CHECKPOINT, RESULTS, RECORD = "checkpoint.pt", "results.json", "record.npz"
PORTION = 100
"""Control steps between two looks at the progress bar."""


def train(
    trial: Trial,
    folder: Path,
    save_every: int = 5_000,
    progress: Callable[[Trial, int], Any] | None = None,
    until: int | None = None,
) -> float:
    """Run a trial to its end, or ``until`` a step, with a checkpoint every ``save_every`` steps.

    Returns the seconds it took.

    A run that is killed loses what came after its last checkpoint, and finds the same again
    when it is resumed. One that is asked to end saves first.

    Raises:
        KeyboardInterrupt: Ctrl-C or SIGTERM came, and the run is saved where it stands.
    """
    began, end = time.monotonic(), min(until or trial.config.steps, trial.config.steps)
    with postponed() as asked:
        while trial.step < end and not asked():
            before = trial.step
            until_save = save_every - before % save_every
            trial.advance(min(PORTION, until_save, end - before))
            if progress:
                progress(trial, trial.step - before)
            if trial.step % save_every == 0 or trial.step == end or asked():
                trial.save(folder / CHECKPOINT)
    return time.monotonic() - began


def results(trial: Trial, steps_taken: int, seconds: float) -> dict[str, Any]:
    """What a run came to, for ``results.json``."""
    config, record = trial.config, trial.record
    rewards = record.rewards.tolist()
    exploring = record.found[: min(config.explore, trial.step)]
    return {
        "version": dntorch.__version__,
        "world": config.world,
        "seed": config.seed,
        "steps": trial.step,
        "steps_per_second": round(steps_taken / seconds, 1) if seconds > 0 else None,
        "duration_seconds": round(seconds, 1),
        "behaviors": len(record.behaviors),
        "behaviors_in_exploration": int((exploring >= 0).sum()),
        "rewards": rewards,
        "first_reward_step": rewards[0] if rewards else None,
        "found_in_exploration": bool(rewards) and rewards[0] < config.explore,
        "optimal_at_end": record.optimal(SequenceTask(config.sequence, config.colors).period),
        "disagreements": record.disagreements,
        "longest_intention_overlap": record.longest_overlap(record.intention),
        "longest_cos_overlap": record.longest_overlap(record.satisfaction),
        "steps_without_state": record.steps_without_state,
        "colors": config.colors,
        "value_matrix_axes": "[state][action]",
        "value_matrix": trial.agent.weights.t().tolist(),
        "config": asdict(config),
    }


def write_results(trial: Trial, folder: Path, content: dict[str, Any]) -> None:
    """Write ``results.json`` and ``record.npz``."""
    write_json(folder / RESULTS, content)
    arrays = trial.record.arrays()
    write_atomically(folder / RECORD, lambda file: np.savez_compressed(file, **arrays))

"""A run to its end: checkpoints on the way, stoppable, resumable; and what it came to."""

import itertools
import json
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
from dntorch.runs.config import Config
from dntorch.runs.pool import Stopped
from dntorch.runs.run import Run, Trial

CHECKPOINT, RESULTS, RECORD = "checkpoint.pt", "results.json", "record.npz"


def train(
    run: Run,
    path: Path,
    save_every: int = 5_000,
    progress: Callable[[Run], Any] = lambda run: None,
    until: int | None = None,
) -> float:
    """Take a run to its end, or ``until`` a step, with a checkpoint every ``save_every`` steps.

    Returns the seconds it took.

    A run that is killed loses what came after its last checkpoint, and finds the same again
    when it is resumed. One that is asked to end, by a signal or by a ``progress`` that returns
    False, saves first.

    Raises:
        KeyboardInterrupt: Ctrl-C or another request to end came; it is saved where it stands.
        Stopped: the same after ``progress`` returned False.
    """
    began, end = time.monotonic(), min(until or run.config.steps, run.config.steps)
    with postponed() as asked:
        while run.step < end and not asked():
            until_save = save_every - run.step % save_every
            run.advance(min(run.engine.portion, until_save, end - run.step))
            stop = True  # what progress raises, as after its terminal was closed, loses no step
            try:
                stop = progress(run) is False
            finally:
                if run.step % save_every == 0 or run.step == end or stop or asked():
                    run.save(path)
            if stop and run.step < end:
                raise Stopped
    return time.monotonic() - began


def results(trial: Trial, steps_taken: int, seconds: float) -> dict[str, Any]:
    """What a run came to, for ``results.json``; without times if it took no step."""
    config, record = trial.config, trial.record
    rewards = record.rewards.tolist()
    rewarded = config.then if config.then and trial.step >= config.change else config.sequence
    exploring = record.found[: min(config.explore, trial.step)]
    return {
        "version": dntorch.__version__,
        "world": config.world,
        "seed": config.seed,
        "steps": trial.step,
        "steps_per_second": round(steps_taken / seconds, 1) if steps_taken and seconds else None,
        "duration_seconds": round(seconds, 1) if steps_taken else None,
        "behaviors": len(record.behaviors),
        "behaviors_in_exploration": int((exploring >= 0).sum()),
        "rewards": rewards,
        "first_reward_step": rewards[0] if rewards else None,
        "found_in_exploration": bool(rewards) and rewards[0] < config.explore,
        "optimal_at_end": record.optimal(SequenceTask(rewarded, config.colors).period),
        "failures": int(trial.agent.failures),
        "disagreements": record.disagreements,
        "longest_intention_overlap": record.longest_overlap(record.intention),
        "longest_cos_overlap": record.longest_overlap(record.satisfaction),
        "steps_without_state": record.steps_without_state,
        "colors": config.colors,
        "value_matrix_axes": "[state][action]",
        "states": names_of_states(config),
        "value_matrix": trial.agent.weights.t().tolist(),
        "config": asdict(config),
    }


def names_of_states(config: Config) -> list[str]:
    """The completions that make each state, in their order, the last one last.

    >>> names_of_states(Config(colors="GB", sequence="GBG", recall=1))
    ['GG', 'BG', 'GB', 'BB']
    """
    orders = itertools.product(config.colors, repeat=config.recall + 1)
    return ["".join(reversed(order)) for order in orders]


TIMES = ("steps_per_second", "duration_seconds")


def write_results(trial: Trial, folder: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Write ``results.json`` and ``record.npz``; returns what the first holds.

    A run that was finished before, and took no step now, keeps the times that it took.
    """
    if content["steps_per_second"] is None and (folder / RESULTS).exists():
        earlier = read_results(folder)
        content = content | {name: earlier[name] for name in TIMES if name in earlier}
    arrays = trial.record.arrays()
    write_atomically(folder / RECORD, lambda file: np.savez_compressed(file, **arrays))
    write_json(folder / RESULTS, content)  # at last: a run that has it is finished
    return content


def read_results(folder: Path) -> dict[str, Any]:
    """What `write_results` wrote.

    Raises:
        ValueError: it is damaged.
    """
    path = folder / RESULTS
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or not isinstance(content.get("config"), dict):
            raise ValueError("it has no config")
    except (ValueError, OSError) as error:
        raise ValueError(
            f"{path} is damaged ({error}): remove it, and the run goes on from its checkpoint"
        ) from error
    return content

"""Runs of the camera world for `reproduce`: a trial a process, remembered as events."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from dntorch import files
from dntorch.cells.functions import is_on
from dntorch.paper.runs import Runs, match
from dntorch.runs.batches import report
from dntorch.runs.config import Config
from dntorch.runs.trial import Trial

SAVE_EVERY = 5_000


def checkpoint_of(folder: Path, seed: int) -> Path:
    """Where a trial is saved; in the end it holds all that was recorded of it."""
    return folder / f"camera-{seed}.pt"


def run_camera(index: int, config: Config, folder: Path) -> bool:
    """One trial from its start, or from where it stopped, to its end; False if told to stop."""
    done, begun = _events_of(folder, config.seed), checkpoint_of(folder, config.seed)
    if not done.exists():
        trial, weights = Trial(config) if not begun.exists() else Trial.load(begun), []
        _check(trial.config, config, begun)
        if begun.exists():
            weights = list(files.load(begun)["onset_weights"])
        while not trial.finished:
            trial.advance(1)
            if trial.record.reported[trial.step - 1] >= 0:
                weights.append(trial.agent.weights.t().numpy().copy())
            go_on = report(index, trial.step)
            if trial.step % SAVE_EVERY == 0 or trial.finished or not go_on:
                content = trial.content() | {"onset_weights": np.array(weights)}
                files.save(begun, content)
            if not go_on:
                return False
        events = _events(trial, np.array(weights))
        trial.close()
        files.write_atomically(done, lambda file: np.savez(file, **events))
    report(index, config.steps)
    return True


def _check(kept: Config, wanted: Config, path: Path) -> None:
    if kept != wanted:
        raise ValueError(f"{path} is of a run with other options: name another folder")


def _events_of(folder: Path, seed: int) -> Path:
    return folder / f"camera-{seed}.npz"


def _events(trial: Trial, weights: np.ndarray) -> dict[str, np.ndarray]:
    record, dt = trial.record, trial.config.dt
    steps = np.flatnonzero(record.reported[: record.length] >= 0)
    finds = np.flatnonzero(record.found[: record.length] >= 0)
    v = record.error[: record.length].astype(np.float64)
    sums = [np.diff(np.concatenate(([0], np.cumsum(x)[steps]))) * dt for x in (v, abs(v))]
    together = is_on(record.intention[: record.length]).sum(1) > 1
    return {
        "steps": steps,
        "behaviors": record.reported[steps].astype(np.int64),
        "finds": np.stack((finds, record.found[finds], record.completed[finds]), 1),
        "error": np.stack(sums, -1),
        "weights": weights.reshape(len(steps), trial.agent.n, trial.agent.n),
        "trouble": np.array([together.sum(), record.steps_without_state]),
        "config": np.array(json.dumps(asdict(trial.config))),
    }


def camera_runs(configs: list[Config], folder: Path) -> Runs:
    """Events of finished trials, a row a run."""
    each = [dict(np.load(_events_of(folder, config.seed))) for config in configs]
    count, longest = len(each), max(len(e["steps"]) for e in each)
    n = len(configs[0].colors)
    steps, behaviors = np.full((2, count, longest), -1, np.int64)
    rewarded, disagreements = np.zeros((count, longest), bool), np.zeros(count, np.int64)
    error, weights = np.zeros((count, longest, 2)), np.zeros((count, longest, n, n), np.float32)
    for run, (e, config) in enumerate(zip(each, configs)):
        _check(Config(**json.loads(str(e["config"]))), config, _events_of(folder, config.seed))
        m = len(e["steps"])
        steps[run, :m], behaviors[run, :m] = e["steps"], e["behaviors"]
        rewarded[run], disagreements[run] = match(steps[run], behaviors[run], e["finds"])
        error[run, :m], weights[run, :m] = e["error"], e["weights"]
    trouble = np.stack([e["trouble"] for e in each], -1)
    return Runs(steps, behaviors, rewarded, error, weights, disagreements, trouble)

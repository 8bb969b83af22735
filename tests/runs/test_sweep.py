"""Many runs side by side: none is lost, and each is what it is alone."""

import csv
import gc
import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from needs import needs

from dntorch.commands.sweep import sweep as command
from dntorch.runs import pool, sweep, table, train
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.run import Run, Trial

RUNS = 12
SHORT = Config(world="nodes", steps=300, explore=200)


def descendants(pid: int) -> list[int]:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    found = list(map(int, children))
    for child in children:
        try:
            found += descendants(int(child))
        except FileNotFoundError:  # it ended meanwhile
            continue
    return found


def named(pids: list[int], name: str) -> list[int]:
    def title(pid: int) -> str:
        try:
            return Path(f"/proc/{pid}/cmdline").read_text()
        except FileNotFoundError:
            return ""

    return [pid for pid in pids if name in title(pid)]


@pytest.mark.parametrize(
    ("how", "worker"),
    [
        (["--processes", "2"], "spawn_main"),
        pytest.param(["--ray", "local"], "ray::settled", marks=needs("ray")),
    ],
)
def test_a_killed_worker_costs_no_run(how: list[str], worker: str, tmp_path: Path) -> None:
    options = ["--world", "nodes", "--set", f"steps={SHORT.steps}", "--set", "explore=200"]
    arguments = [*options, "--seeds", f"0-{RUNS - 1}", "--checkpoint-every", "50", *how]
    process = subprocess.Popen(
        [sys.executable, "-m", "dntorch.cli", "sweep", *arguments, "--out", tmp_path],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    while len(done := list(tmp_path.glob("*/results.json"))) < 4:
        assert process.poll() is None, process.stdout.read()
        time.sleep(0.02)
    times = {path: path.stat().st_mtime_ns for path in done}
    assert len(done) < RUNS
    victims = named(descendants(process.pid), worker)
    os.kill(victims[0], signal.SIGKILL)
    output, _ = process.communicate(timeout=240)
    assert process.returncode == 0, output
    if worker == "spawn_main":
        assert "a worker was killed" in output
    assert {path: path.stat().st_mtime_ns for path in done} == times  # none runs twice
    rows = list(csv.DictReader(io.StringIO((tmp_path / "table.csv").read_text())))
    assert [int(row["seed"]) for row in rows] == list(range(RUNS))
    alone = Trial(Config(world="nodes", steps=SHORT.steps, explore=200, seed=7))
    alone.advance(SHORT.steps)
    assert json.loads(rows[7]["value_matrix"]) == alone.agent.weights.t().tolist()
    assert int(rows[7]["behaviors"]) == len(alone.record.behaviors)


@pytest.mark.parametrize(
    ("batch", "how"),
    [(1, []), (2, []), pytest.param(1, ["--ray", "local"], marks=needs("ray"))],
    ids=str,
)
def test_a_sweep_that_is_asked_to_end_keeps_its_runs(batch: int, how, tmp_path: Path) -> None:
    steps, seeds = 2000, range(4 * batch)
    options = ["--world", "nodes", "--set", f"steps={steps}", "--set", "explore=200"]
    options += ["--seeds", f"0-{seeds[-1]}", "--batch", str(batch), "--processes", "2"]
    options += ["--out", str(tmp_path)]
    started = [sys.executable, "-m", "dntorch.cli", "sweep", *options, *how]
    with subprocess.Popen(started, stderr=subprocess.PIPE, text=True) as process:
        while len(done := list(tmp_path.glob("*/results.json"))) < batch:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.02)
        time.sleep(1.0)  # whoever finished is in the midst of the next run
        process.send_signal(signal.SIGTERM)
        try:
            _, errors = process.communicate(timeout=60)
        finally:
            process.kill()  # one that hangs would hang the tests
    assert process.returncode == 130, errors
    assert "stopped; the same command goes on with the runs that are left" in errors
    assert "Traceback" not in errors
    saved = {path.parent for path in tmp_path.glob("*/*.pt")}
    finished = {path.parent for path in tmp_path.glob("*/results.json")}
    assert len(finished) < len(seeds) and (how or saved - finished)  # Ray kills at once
    times = {path: path.stat().st_mtime_ns for path in done}
    again = CliRunner().invoke(command, options)  # on this machine, wherever it began
    assert again.exit_code == 0, again.output
    rows = list(csv.DictReader(io.StringIO((tmp_path / "table.csv").read_text())))
    assert [int(row["seed"]) for row in rows] == list(seeds)
    if batch == 1:
        assert {path: path.stat().st_mtime_ns for path in done} == times  # none runs twice
    for row in rows[:3]:
        alone = Trial(Config(world="nodes", steps=steps, explore=200, seed=int(row["seed"])))
        alone.advance(steps)
        values = alone.agent.weights.t()
        assert torch.allclose(torch.tensor(json.loads(row["value_matrix"])), values, atol=1e-4)
        assert int(row["behaviors"]) == len(alone.record.behaviors)


def poison(task: sweep.Batch, report) -> sweep.Table:
    if task.configs[0].seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return sweep.run(task, report)


def test_a_run_that_always_dies_is_named_and_the_others_finish(tmp_path: Path) -> None:
    configs = sweep.grid(SHORT, [0, 1, 2], {})
    tasks = sweep.plan(configs, tmp_path)
    done = list(pool.in_processes(poison, tasks, 1, retries=1, notice=lambda _: None))
    errors = {one.task.configs[0].seed: one.error for one in done}
    assert errors == {0: "", 1: "killed 2 times", 2: ""}


# ------------------------------------------------------------------ a batch


def several() -> tuple[Config, ...]:
    common = {"world": "nodes", "steps": 800, "explore": 700, "sequence": "GB", "colors": "GB"}
    return (
        Config(**common, seed=0),
        Config(**common, seed=4, learning_rate=0.03),
        Config(**common, seed=4, trace_tau=0.8),
        Config(**common, seed=9, reward=1.0, reward_duration=0.5, noise=5.0),
    )


def test_members_of_a_batch_do_what_they_do_alone() -> None:
    together = Run(Group.of(several()))
    together.advance(800)
    for k, config in enumerate(several()):
        alone, member = Trial(config), together.member(k)
        alone.advance(800)
        assert np.array_equal(member.record.found, alone.record.found)
        assert np.array_equal(member.record.reported, alone.record.reported)
        assert torch.allclose(member.agent.weights, alone.agent.weights, atol=1e-4)
        assert alone.agent.weights.abs().max() > 0.01
        ours, theirs = (train.results(trial, 800, 0.0) for trial in (member, alone))
        ours.pop("value_matrix"), theirs.pop("value_matrix")
        assert ours == theirs


def test_a_batch_that_was_killed_goes_on_to_the_same_numbers(tmp_path: Path) -> None:
    whole, begun = Run(Group.of(several())), Run(Group.of(several()))
    train.train(whole, tmp_path / "whole.pt", 300)
    begun.advance(450)
    begun.save(tmp_path / "killed.pt")
    resumed = Run(Group.of(several())).restore(tmp_path / "killed.pt")
    train.train(resumed, tmp_path / "killed.pt", 300)
    for ours, theirs in ((resumed.member(k), whole.member(k)) for k in range(4)):
        assert torch.equal(ours.agent.weights, theirs.agent.weights)
        assert np.array_equal(ours.record.found, theirs.record.found)
        assert np.array_equal(ours.record.satisfaction, theirs.record.satisfaction)


def test_a_batch_is_not_taken_for_another(tmp_path: Path) -> None:
    begun = Run(Group.of(several()))
    begun.save(tmp_path / "batch.pt")
    others = tuple(replace(config, seed=config.seed + 10) for config in several())
    with pytest.raises(ValueError, match="another group of runs: name another folder"):
        Run(Group.of(others)).restore(tmp_path / "batch.pt")
    first, second = (sweep.grid(SHORT, seeds, {}) for seeds in ([0, 1], [0, 5]))
    for configs in (first, second):
        sweep.run(*sweep.plan(configs, tmp_path, batch=2))
    alone = Trial(second[1])
    alone.advance(SHORT.steps)
    kept = Trial.load(tmp_path / sweep.name_of(second[1]) / "checkpoint.pt")
    assert np.array_equal(kept.record.found, alone.record.found)


def test_a_member_can_go_on_alone(tmp_path: Path) -> None:
    together = Run(Group.of(several()))
    together.advance(300)
    alone, member = Trial(several()[1]), together.member(1)
    alone.advance(500)
    member.save(tmp_path / "c.pt")
    member = Trial.load(tmp_path / "c.pt")
    member.advance(200)
    assert np.array_equal(member.record.found[:500], alone.record.found[:500])


def test_runs_of_different_length_are_no_batch(tmp_path: Path) -> None:
    configs = sweep.grid(SHORT, [0, 1, 2], {"steps": [300, 400]})
    tasks = sweep.plan(configs, tmp_path, batch=2)
    assert [len(task.configs) for task in tasks] == [2, 1, 2, 1]
    with pytest.raises(ValueError, match="make no batch"):
        Group.of(tuple(configs))


# ------------------------------------------------------------------ tables and commands


def test_one_table_in_three_formats(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    tasks = sweep.plan(sweep.grid(SHORT, [0, 1], {"noise": [5.0, 10.0]}), tmp_path, batch=8)
    results = [one for task in tasks for one in sweep.run(task)]
    paths = table.write(tmp_path, results)
    assert [path.name for path in paths] == ["table.csv", "table.jsonl", "table.parquet"]
    lines = [json.loads(line) for line in paths[1].read_text().splitlines()]
    assert parquet.read_table(paths[2]).to_pylist() == lines
    assert [(one["noise"], one["seed"]) for one in lines] == [(5, 0), (5, 1), (10, 0), (10, 1)]
    for text, one in zip(csv.DictReader(io.StringIO(paths[0].read_text())), lines):
        assert float(text["noise"]) == one["noise"] and int(text["rewards"]) == one["rewards"]
        assert json.loads(text["value_matrix"]) == one["value_matrix"]


@needs("ray")
def test_a_cluster_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    tasks = sweep.plan(sweep.grid(SHORT, [0], {}), tmp_path)
    with pytest.raises(ConnectionError, match=r"address='auto': .*; name a cluster that runs"):
        list(pool.on_ray(sweep.run, tasks, "auto"))


# submitit's executor for debugging, which runs jobs in this process, leaves its logs open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
def test_slurm_jobs_are_the_same_runs(tmp_path: Path) -> None:
    tasks = sweep.plan(sweep.grid(SHORT, [0, 1], {}), tmp_path)
    (tmp_path / "slurm").mkdir()
    done = list(pool.on_slurm(sweep.run, tasks, tmp_path, cluster="debug"))
    assert [one.error for one in done] == ["", ""]
    assert {one.result[0]["seed"] for one in done} == {0, 1}
    gc.collect()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seeds", "a-b"], ["--seeds=a-b", "such as 0-9"]),
        (["--set", "color=1"], ["'color' cannot be set", "learning_rate"]),
        (["--set", "steps=many"], ["steps=many", "give a whole number", "100000"]),
        (["--set", "explore=50000", "--set", "steps=10"], ["explore=50000", "steps=10"]),
        pytest.param(["--batch", "4"], ["batch=4", "leave it out"], marks=needs("pybullet")),
        (["--world", "ring", "--seeds", "1,1"], ["seed1", "twice"]),
        (["--seeds", "0-99999", "--set", "noise=1,2,3"], ["300,000 runs", "give at most 100,000"]),
        (["--set", "noise=5", "--set", "noise=6"], ["--set noise", "give NAME=VALUE,VALUE"]),
        (["--set", "reward=nan"], ["--set=reward=nan", "give a number"]),
    ],
)
def test_bad_input_names_what_to_give(arguments, words, tmp_path: Path) -> None:
    done = CliRunner().invoke(command, [*arguments, "--out", str(tmp_path / "s")])
    assert isinstance(done.exception, ValueError)
    assert all(word in str(done.exception) for word in words), done.exception


def test_a_folder_of_another_run_is_not_taken_for_this_one(tmp_path: Path) -> None:
    (mine,) = sweep.plan([SHORT], tmp_path)
    sweep.run(mine)
    results = tmp_path / sweep.name_of(SHORT) / "results.json"
    results.write_text(results.read_text().replace('"noise": 10.0', '"noise": 9.0'))
    with pytest.raises(ValueError, match="another folder"):
        sweep.run(mine)

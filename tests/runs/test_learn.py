"""Runs that stop and go on, and what the command line answers."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from needs import EPUCK
from waiting import wait

from dntorch import files
from dntorch.cli import main
from dntorch.commands import dntorch
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.group import Group
from dntorch.runs.run import Run, Trial

WORLDS = ["nodes", EPUCK]


def same(a, b, where: str = "") -> None:
    """Assert that two nested contents are equal to the last bit."""
    assert type(a) is type(b), where
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            same(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, (list, tuple)):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b)):
            same(x, y, f"{where}[{k}]")
    elif isinstance(a, torch.Tensor):
        assert torch.equal(a, b), where
    elif isinstance(a, np.ndarray):
        assert np.array_equal(a, b), where
    else:
        assert a == b, where


def run(*arguments: object, **options) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "dntorch.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def here(*arguments: object) -> None:
    """Run a command in this process, which has imported PyTorch already."""
    done = CliRunner().invoke(dntorch, list(map(str, arguments)))
    assert done.exit_code == 0, (done.output, done.exception)


@pytest.mark.parametrize("world", WORLDS)
def test_a_resumed_run_goes_on_to_the_same_numbers(world: str, tmp_path: Path) -> None:
    config = Config(world=world, steps=400, explore=300, seed=3)
    whole, first = Trial(config), Trial(config)
    whole.advance(400)
    first.advance(170)
    first.save(tmp_path / "c.pt")
    second = Trial.load(tmp_path / "c.pt")
    assert second.step == 170
    second.advance(1000)
    assert second.step == 400
    same(second.content(), whole.content())


PARTS = AUTONOMOUS | {"recall": 1, "patience": 4.0, "constraints": 20.0, "missing": "B",
                      "sequence": "GYRG", "then": "YRGY", "change": 200}  # fmt: skip
"""Of an agent with parts of its own in a world that changes and lacks a colour."""
WITH_PARTS = pytest.mark.parametrize("config", [
    Config(world="nodes", steps=400, explore=400, seed=3, curiosity=4.0, **PARTS),
    Config(world="ring", steps=300, explore=300, seed=1, **PARTS),
    pytest.param(
        Config(world="epuck", steps=300, explore=300, seed=1, curiosity=4.0, **PARTS),
        marks=EPUCK.marks,
    ),
], ids=["nodes", "ring", "epuck"])  # fmt: skip


@WITH_PARTS
def test_a_run_with_every_part_resumes_to_the_same_numbers(config: Config, tmp_path: Path) -> None:
    whole, first = Trial(config), Trial(config)
    whole.advance(config.steps)
    assert whole.agent.failures > 0
    first.advance(170)
    first.save(tmp_path / "c.pt")
    by_file, by_call = Trial.load(tmp_path / "c.pt"), Run(config).restore(tmp_path / "c.pt")
    assert by_file.step == by_call.step == 170
    for second in (by_file, by_call):
        second.advance(1000)
        same(second.content(), whole.content())


def test_learn_goes_on_with_every_part(tmp_path: Path) -> None:
    words = ["--world", "nodes", "--autonomous", "--recall", 1, "--constraints", 20, "--curiosity",
             4, "--steps", 300, "--seed", 3, "--no-compile"]  # fmt: skip
    here("learn", *words, "--out", tmp_path / "whole")
    config = Trial.load(tmp_path / "whole" / "checkpoint.pt").config
    half = Trial(config)
    half.advance(130)
    (tmp_path / "half").mkdir()
    half.save(tmp_path / "half" / "checkpoint.pt")
    here("learn", "--resume", tmp_path / "half")
    ended = [Trial.load(tmp_path / name / "checkpoint.pt") for name in ("whole", "half")]
    assert ended[1].step == 300
    same(ended[1].content(), ended[0].content())


def test_a_batch_with_every_part_resumes_to_the_same_numbers(tmp_path: Path) -> None:
    group = Group(Config(world="nodes", steps=300, explore=300, curiosity=4.0, **PARTS), (0, 1, 2))
    whole, first = Run(group, events=True), Run(group, events=True)
    whole.advance(300)
    first.advance(110)
    first.save(tmp_path / "c.pt")
    second = Run(group, events=True).restore(tmp_path / "c.pt")
    second.advance(300)
    assert whole.agent.failures.any()
    same(second.content(), whole.content())


def test_saving_changes_nothing(tmp_path: Path) -> None:
    config = Config(world="ring", steps=120, explore=100)
    plain, saved = Trial(config), Trial(config)
    plain.advance(120)
    for _ in range(6):
        saved.advance(20)
        saved.save(tmp_path / "c.pt")
    same(saved.content(), plain.content())


DIES_WHILE_SAVING = """
import os, signal, sys
from dntorch import files
saves = 0
def dying(fd):
    global saves
    saves += 1
    if saves == 3:  # the content is written in part, the file does not yet bear its name
        os.ftruncate(fd, 1000)
        os.kill(os.getpid(), signal.SIGKILL)
files.os.fsync = dying
sys.argv = ["dntorch", *sys.argv[1:]]
from dntorch.cli import main
from dntorch.commands import dntorch
main()
"""


def test_a_run_killed_three_times_ends_as_the_uninterrupted_one(tmp_path: Path) -> None:
    options = ["--world", "ring", "--steps", 400, "--explore", 300, "--seed", 5]
    options += ["--checkpoint-every", 20]
    quick = ["--no-video", "--checkpoint-every", 20]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    here("learn", *options, "--no-video", "--out", whole)

    resume = ["learn", *quick, "--resume", killed]
    dying = [sys.executable, "-c", DIES_WHILE_SAVING]
    began = subprocess.run(
        [*dying, *map(str, ["learn", *options, "--no-video", "--out", killed])],
        capture_output=True,
        timeout=120,
    )
    assert began.returncode == -signal.SIGKILL
    moments = random.Random(0)
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, "-m", "dntorch.cli", *map(str, resume)],
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        written = (killed / "checkpoint.pt").stat().st_mtime_ns
        while (killed / "checkpoint.pt").stat().st_mtime_ns == written:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.001)
        time.sleep(moments.uniform(0, 0.05))
        process.send_signal(signal.SIGKILL)
        assert process.wait(timeout=60) == -signal.SIGKILL
    assert 0 < Trial.load(killed / "checkpoint.pt").step < 400
    here(*resume)

    same(files.load(killed / "checkpoint.pt"), files.load(whole / "checkpoint.pt"))
    ours, theirs = (json.loads((d / "results.json").read_text()) for d in (killed, whole))
    for timing in ("steps_per_second", "duration_seconds"):
        ours.pop(timing), theirs.pop(timing)
    assert ours == theirs


def test_ctrl_c_saves_and_says_how_to_go_on(tmp_path: Path) -> None:
    out = tmp_path / "run"
    options = ["--world", "nodes", "--no-compile", "--checkpoint-every", "200", "--out", out]
    with subprocess.Popen(
        [sys.executable, "-m", "dntorch.cli", "learn", *options], stderr=subprocess.PIPE, text=True
    ) as process:
        checkpoint = out / "checkpoint.pt"
        assert wait(checkpoint.exists, 300)
        first = checkpoint.stat().st_mtime_ns
        assert wait(lambda: checkpoint.stat().st_mtime_ns > first, 300)  # it takes steps
        checkpoint.unlink()  # another one is what the request to end has saved
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"--resume {out}" in errors and "Traceback" not in errors
    trial = Trial.load(out / "checkpoint.pt")
    assert trial.step > 0
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    whole = Trial(trial.config)
    whole.advance(trial.step)  # saved where agent and world stand at the same step
    same(trial.content(), whole.content())


def test_results_hold_what_a_reader_needs(tmp_path: Path) -> None:
    out = tmp_path / "run"
    here("learn", "--world", "nodes", "--steps", 900, "--explore", 600, "--out", out)
    results = json.loads((out / "results.json").read_text())
    assert results["world"] == "nodes" and results["seed"] == 1 and results["steps"] == 900
    assert results["behaviors"] >= 4 and results["steps_per_second"] > 0
    assert results["rewards"] == [] and results["first_reward_step"] is None
    assert results["optimal_at_end"] is False
    assert np.shape(results["value_matrix"]) == (4, 4)
    assert (out / "report.html").stat().st_size > 10_000
    assert (out / "checkpoint.pt").exists() and (out / "record.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--colors", "RGBX"], ["RGBX", "ROYGCBVM"]),
        (["--sequence", "GGB"], ["GGB", "put another letter between"]),
        (["--sequence", "GCB"], ["'C'", "use letters of colors"]),
        (["--dt", "0.2"], ["dt=0.2", "smaller dt"]),
        (["--explore", "200", "--steps", "100"], ["explore=200", "steps=100"]),
        (["--seed", "-1"], ["seed=-1", "from 0"]),
        (["--width", "0"], ["--width=0", "give a whole number from 8 to 640"]),
        (["--substeps", "0"], ["substeps=0"]),
        (["--world", "mars"], ["mars", "epuck"]),
        (["--nonsense"], ["--nonsense"]),
        (["--resume", "no/such/run"], ["no/such/run", "name a folder that holds a run"]),
        (["--out", "{file}/below"], ["--out", "name another"]),
        (["--resume", ".", "--seed", "1"], ["--seed", "leave --seed out"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments, names, tmp_path: Path, monkeypatch, capsys
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["dntorch", "learn", *(a.format(file=tmp_path / "file") for a in arguments)]
    )
    with pytest.raises(SystemExit) as exit:
        main()
    assert exit.value.code == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1, error
    for name in names:
        assert name in error


def test_a_folder_that_holds_a_run_is_not_overwritten(tmp_path: Path) -> None:
    Trial(Config(world="nodes")).save(tmp_path / "checkpoint.pt")
    done = run("learn", "--world", "nodes", "--out", tmp_path)
    assert done.returncode == 2 and f"--resume {tmp_path}" in done.stderr


@pytest.mark.parametrize("damage", ["truncated", "empty", "garbage", "other"])
def test_a_damaged_checkpoint_is_refused(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.pt"
    Trial(Config(world="nodes")).save(path)
    if damage == "other":
        torch.save({"weights": torch.zeros(3)}, path)
    else:
        whole = path.read_bytes()
        path.write_bytes({"truncated": whole[:-500], "empty": b"", "garbage": b"x" * 999}[damage])
    with pytest.raises(ValueError, match="name another"):
        Trial.load(path)


def test_a_checkpoint_of_another_architecture_is_refused(tmp_path: Path) -> None:
    trial = Trial(Config(world="nodes", colors="RGBYM"))
    content = trial.content()
    content["agent"] = Trial(Config(world="nodes")).agent.snapshot()
    files.save(tmp_path / "c.pt", content)
    with pytest.raises(ValueError, match=r"another architecture.*build the structure"):
        Trial.load(tmp_path / "c.pt")


def test_loading_runs_no_code(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "exploded"),)

    torch.save({"format": files.FORMAT, "bomb": Bomb()}, tmp_path / "c.pt")
    with pytest.raises(ValueError, match="no readable checkpoint"):
        Trial.load(tmp_path / "c.pt")
    assert not (tmp_path / "exploded").exists()

"""What a run has saved stays: with others in its folder, on a full disk, without its terminal."""

import fcntl
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from waiting import wait

from dntorch import files
from dntorch.commands import dntorch
from dntorch.process import postponed
from dntorch.runs import sweep, train
from dntorch.runs.config import Config
from dntorch.runs.events import Events
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job, run_groups
from dntorch.runs.run import Trial, load_trained

LONG = ["--world", "nodes", "--no-compile", "--checkpoint-every", "20"]
SHORT = Config(world="nodes", steps=300, explore=200)
WAIT = 200.0
"""s, for processes to start and to end."""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "dntorch.cli", *map(str, arguments)]


def run(*arguments: object, **options) -> subprocess.CompletedProcess:
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=WAIT, **options
    )


def here(*arguments: object) -> None:
    """Run a command in this process, which has imported PyTorch already."""
    done = CliRunner().invoke(dntorch, list(map(str, arguments)))
    assert done.exit_code == 0, (done.output, done.exception)


def until(condition, process: subprocess.Popen | None = None) -> None:
    ended = lambda: process is not None and process.poll() is not None  # noqa: E731
    assert wait(lambda: condition() or ended(), WAIT), "in vain"
    assert condition() or not ended(), "it ended too early"


def one_line(done: subprocess.CompletedProcess) -> str:
    errors = [line for line in done.stderr.splitlines() if line.startswith("dntorch: ")]
    assert done.returncode == 2 and len(errors) == 1, done.stderr
    assert "Traceback" not in done.stderr
    return errors[0]


# ---------------------------------------------------------------- one process in a folder


@pytest.fixture
def running(tmp_path: Path):
    """A run in its folder, which has been saved twice."""
    out = tmp_path / "run"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command("learn", *LONG, "--out", out), **quiet) as process:
        try:
            until((out / "checkpoint.before.pt").exists, process)
            yield process, out
        finally:
            process.kill()


def test_a_second_process_is_refused_with_the_name_of_the_first(running) -> None:
    process, out = running
    error = one_line(run("learn", "--resume", out, "--no-video"))
    assert f"{out} is in use by process {process.pid} on " in error


def test_what_a_killed_run_left_is_removed_when_it_is_resumed(running) -> None:
    process, out = running
    process.kill()
    process.wait(timeout=WAIT)
    (out / ".checkpoint.pt.x.part").touch()
    (out / "checkpoint.pt").write_bytes(b"")  # which ends the next process soon
    assert "rename" in one_line(run("learn", "--resume", out))
    assert [path.name for path in out.glob(".*")] == []


def test_runs_of_a_sweep_are_locked_each(tmp_path: Path, monkeypatch) -> None:
    (task,) = sweep.plan([SHORT], tmp_path)
    monkeypatch.setattr(sweep, "PATIENCE", 0.0)
    (tmp_path / "seed0").mkdir(parents=True)
    folder = tmp_path / sweep.name_of(SHORT)
    folder.mkdir(exist_ok=True)
    with sweep.owned(folder), pytest.raises(ValueError, match="is in use by process"):
        sweep.run(task)
    assert sweep.run(task)[0]["steps"] == 300


def test_a_sweep_and_a_study_lock_their_folder(tmp_path: Path) -> None:
    with sweep.owned(tmp_path):
        assert "is in use by" in one_line(run("sweep", *LONG, "--seeds", "0", "--out", tmp_path))
        with pytest.raises(ValueError, match="is in use by process"):
            run_groups([Job("study", Group(SHORT, (0,)))], tmp_path, 1)


# ---------------------------------------------------------------- processes


def alive(pids: list[int]) -> list[int]:
    def runs(pid: int) -> bool:
        try:
            return ") Z" not in Path(f"/proc/{pid}/stat").read_text()
        except FileNotFoundError:
            return False

    return [pid for pid in pids if runs(pid)]


def below(pid: int) -> list[int]:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [one for child in map(int, children) for one in (child, *below(child))]


@pytest.mark.skipif(not Path("/proc").exists(), reason="finds processes in /proc")
def test_workers_of_a_killed_sweep_end_with_it(tmp_path: Path) -> None:
    arguments = ["sweep", *LONG, "--seeds", "0-3", "--processes", "2", "--out", tmp_path]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command(*arguments), **quiet) as process:
        try:
            until(lambda: len(list(tmp_path.glob("*/checkpoint.pt"))) == 2, process)
            workers = below(process.pid)
            assert len(alive(workers)) >= 2
        finally:
            process.kill()
    until(lambda: not alive(workers))


def test_a_closed_terminal_ends_a_run_that_has_saved(tmp_path: Path) -> None:
    out, (ours, theirs) = tmp_path / "run", os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with subprocess.Popen(
        command("learn", *LONG, "--out", out),
        stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as process:  # fmt: skip
        os.close(theirs)
        try:
            written = b""
            while b"behaviors=" not in written:  # the run has begun
                written += os.read(ours, 4096)
            os.close(ours)
            process.wait(timeout=WAIT)
        finally:
            process.kill()
    assert process.returncode > 0  # not killed by the signal
    trial = Trial.load(out / "checkpoint.pt")
    assert trial.step > 0 and not list(out.glob(".*"))
    whole = Trial(trial.config)
    whole.advance(trial.step)
    assert torch.equal(whole.agent.weights, trial.agent.weights)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_request_to_end_waits_for_the_end_of_the_step(name: str) -> None:
    number = getattr(signal, name)
    with pytest.raises(KeyboardInterrupt), postponed() as asked:
        assert not asked()
        signal.raise_signal(number)
        assert asked()


def test_a_run_under_nohup_outlives_its_terminal() -> None:
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with postponed() as asked:
            signal.raise_signal(signal.SIGHUP)
            assert not asked()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, former)


def test_an_error_of_whoever_listens_loses_no_step(tmp_path: Path) -> None:
    def progress(trial: Trial) -> None:
        raise OSError("the terminal is gone")

    trial = Trial(SHORT)
    with pytest.raises(OSError, match="terminal"):
        train.train(trial, tmp_path / "c.pt", 200, progress)
    assert Trial.load(tmp_path / "c.pt").step == trial.step > 0


# ---------------------------------------------------------------- files of a run


def small_files(size: int):
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


def test_a_disk_that_is_full_is_one_line_and_the_run_goes_on_later(tmp_path: Path) -> None:
    out, options = tmp_path / "run", ["--world", "nodes", "--steps", 900, "--explore", 600]
    quiet = ["--no-compile", "--no-video", "--checkpoint-every", 200]
    Trial(SHORT).save(tmp_path / "c.pt")
    begun = (tmp_path / "c.pt").stat().st_size
    done = run("learn", *options, *quiet, "--out", out, preexec_fn=small_files(begun + 15_000))
    assert f"{out / 'checkpoint.pt'} cannot be written (File too large)" in one_line(done)
    step = Trial.load(out / "checkpoint.pt").step
    assert step < 900 and not list(out.glob(".*"))
    here("learn", "--resume", out, *quiet[1:])
    whole = Trial(Trial.load(out / "checkpoint.pt").config)
    whole.advance(900)
    assert torch.equal(whole.agent.weights, load_trained(out / "checkpoint.pt")[0].weights)


def test_a_finished_run_that_is_resumed_keeps_its_results(tmp_path: Path) -> None:
    out = tmp_path / "run"
    options = ["--world", "nodes", "--steps", 300, "--explore", 200]
    here("learn", *options, "--out", out)
    before = json.loads((out / "results.json").read_text())
    assert before["duration_seconds"] > 0 and before["steps_per_second"] > 0
    for _ in range(2):
        here("learn", "--resume", out)
        assert json.loads((out / "results.json").read_text()) == before


def test_a_run_that_took_no_step_has_no_times() -> None:
    trial = Trial(SHORT)
    trial.advance(300)
    came_to = train.results(trial, 0, 1e-5)
    assert came_to["duration_seconds"] is came_to["steps_per_second"] is None


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"config": 3}'])
def test_damaged_results_are_named(content: str, tmp_path: Path) -> None:
    (task,) = sweep.plan([SHORT], tmp_path)
    sweep.run(task)
    path = tmp_path / sweep.name_of(SHORT) / "results.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"results.json is damaged .*: remove it"):
        sweep.run(task)
    path.unlink()
    assert sweep.run(task)[0]["steps"] == 300


def test_damaged_events_are_named(tmp_path: Path) -> None:
    jobs = [Job("study", Group(SHORT, (0, 1)))]
    whole = run_groups(jobs, tmp_path, 1)
    path = tmp_path / "study-0.npz"
    content = bytearray(path.read_bytes())
    for place in (0, len(content) // 2, len(content) - 30):
        damaged = content.copy()
        damaged[place] ^= 255
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"study-0.npz is damaged .*: remove it"):
            run_groups(jobs, tmp_path, 1)
    path.unlink()
    again = run_groups(jobs, tmp_path, 1)
    assert all(np.array_equal(again["study"][name], whole["study"][name]) for name in ("onset",))


WRONG = {
    "step": lambda c: c.update(step="three"),
    "step before the first": lambda c: c.update(step=-1),
    "step beyond the last": lambda c: c.update(step=10**9),
    "step in parts": lambda c: c.update(step=2.5),
    "no step": lambda c: c.pop("step"),
    "seen": lambda c: c.update(seen=[{}, 3]),
    "seen of one": lambda c: c.update(seen=[]),
    "rows of memory": lambda c: c["memory"].update(reward=c["memory"]["reward"][:-1]),
    "numbers of memory": lambda c: c["memory"].update(found=c["memory"]["found"] * 1.0),
    "memory": lambda c: c.update(memory={"length": 3}),
    "memory of another kind": lambda c: c.update(memory=None),
    "world": lambda c: c.update(world={}),
    "world of a batch": lambda c: c.update(world=[torch.zeros(7) for _ in c["world"]]),
    "agent": lambda c: c.update(agent=[]),
    "config": lambda c: c.update(config={"planet": "mars"}),
    "config of another kind": lambda c: c.update(config=3),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_checkpoint_with_other_content_is_one_sentence(name: str, tmp_path: Path) -> None:
    trial = Trial(SHORT)
    trial.advance(3)
    content = trial.content()
    WRONG[name](content)
    files.save(tmp_path / "c.pt", content)
    with pytest.raises(ValueError) as raised:
        Trial.load(tmp_path / "c.pt")
    assert "\n" not in str(raised.value)
    words = ("of another version of dntorch", "build the structure", "it was taken of")
    assert str(tmp_path / "c.pt") in str(raised.value)
    assert any(text in str(raised.value) for text in words), raised.value


def test_an_event_log_of_a_batch_goes_through_a_file(tmp_path: Path) -> None:
    from dntorch.runs.run import Run

    whole, begun = (Run(Group(SHORT, (0, 1)), events=True) for _ in range(2))
    whole.advance(300)
    begun.advance(150)
    begun.save(tmp_path / "c.pt")
    resumed = Run(Group(SHORT, (0, 1)), events=True).restore(tmp_path / "c.pt")
    resumed.advance(300)
    assert isinstance(resumed.memory, Events)
    ours, theirs = resumed.memory.joined(), whole.memory.joined()
    assert ours.keys() == theirs.keys()
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours)

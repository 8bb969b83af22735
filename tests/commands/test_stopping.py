"""Requests to end at the worst moments: each command says how to go on, and prints no traceback."""

import signal
from pathlib import Path

import pytest
import tqdm
from click.testing import CliRunner

from dntorch.commands import dntorch
from dntorch.process import REQUESTS

SHORT = ["--world", "nodes", "--steps", "200", "--no-compile"]
COMMANDS = {
    "learn": ["learn", *SHORT],
    "reproduce": ["reproduce", "--world", "nodes", "--steps", "200", "--runs", "2"],
    "sweep": ["sweep", *SHORT, "--seeds", "0-1"],
}
REMEDIES = {
    "learn": "stopped; go on with: dntorch learn --resume {out}",
    "reproduce": "stopped; go on with: dntorch reproduce --resume {out}",
    "sweep": "stopped; the same command goes on with the runs that are left",
}


@pytest.fixture(autouse=True)
def handlers():
    """Those of the tests themselves."""
    former = {number: signal.getsignal(number) for number in REQUESTS}
    yield
    for number, handler in former.items():
        signal.signal(number, handler)


def asked_in_the_making(number: signal.Signals) -> type:
    class Bar(tqdm.tqdm):
        def __init__(self, *arguments, **options) -> None:
            signal.raise_signal(number)
            super().__init__(*arguments, **options)

    return Bar


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", REQUESTS, ids=lambda number: number.name)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_request_while_the_bar_is_made(command, number, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(tqdm, "tqdm", asked_in_the_making(number))
    out = tmp_path / "out"
    done = CliRunner().invoke(dntorch, [*COMMANDS[command], "--out", str(out)])
    assert done.exit_code == 130, (done.output, done.exception)
    assert REMEDIES[command].format(out=out) in done.output
    assert "Traceback" not in done.output


@pytest.mark.parametrize("number", REQUESTS, ids=lambda number: number.name)
def test_a_request_after_the_last_step(number, tmp_path: Path, monkeypatch) -> None:
    """While figures are drawn, all was learned: the command to go on draws them."""
    from dntorch.show import figures

    out = tmp_path / "out"
    with monkeypatch.context() as drawing:
        drawing.setattr(figures, "write_figures", lambda *_: signal.raise_signal(number))
        done = CliRunner().invoke(dntorch, [*COMMANDS["learn"], "--out", str(out)])
    assert done.exit_code == 130
    assert REMEDIES["learn"].format(out=out) in done.output
    done = CliRunner().invoke(dntorch, ["learn", "--resume", str(out)])
    assert done.exit_code == 0, done.output
    assert (out / "report.html").exists()

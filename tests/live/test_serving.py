"""The server of a page, and the command that starts it."""

import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
import webbrowser
from pathlib import Path

import pytest
from click.testing import CliRunner
from needs import needs
from small_runs import write_run

from dntorch import DNF, view
from dntorch.commands import dntorch

pytestmark = needs("bokeh")


def fetched(url: str) -> str:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return answer.read().decode()


def test_a_page_is_served_until_it_is_stopped(monkeypatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    first, second = view(DNF(5)), view(DNF(6), browser=False, play=True)
    assert opened == [first.url] and first.url.startswith("http://127.0.0.1:")
    assert "dntorch: DNF" in fetched(first.url) and first.url != second.url
    assert second.session.playing and second.session.steps == 0  # nobody looks
    first.stop()
    first.stop()
    first.wait()
    with pytest.raises(urllib.error.URLError):
        fetched(first.url)
    assert fetched(second.url)
    second.stop()
    assert second.structure.shape == [6]


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"port={port} on host=127.0.0.1: Address already"):
            view(DNF(5), port=port, browser=False)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("nowhere", "TARGET=nowhere: it is not there"),
        (". --no-browser", "holds no run"),
        (". --port 70000", "--port=70000: give"),
        (". --host a..b", "--host=a..b: give a name"),
    ],
)
def test_what_cannot_be_opened_is_one_sentence(
    arguments: str, sentence: str, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(dntorch, ["view", *arguments.split()])
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1, done.output
    assert sentence in done.stderr


def test_ctrl_c_ends_the_command(tmp_path: Path) -> None:
    write_run(tmp_path)
    command = [sys.executable, "-m", "dntorch", "view", str(tmp_path), "--no-browser"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:  # fmt: skip
        try:
            url = process.stdout.readline().split(" at ")[1].strip()
            assert str(tmp_path) in fetched(url)
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert errors.strip() == "stopped; the same command opens it again"

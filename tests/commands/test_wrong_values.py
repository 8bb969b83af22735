"""Every option of every command with wrong values: one line, exit code 2, and nothing done.

The commands are walked, so that an option which is added tomorrow is tried as well.
"""

import re
import socket
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from needs import needs

from dntorch.commands import common, dntorch
from dntorch.commands.kinds import Number, Parsed, Place

#: What each command cannot do without.
NEEDED = {
    "export": ["{folder}", "--to", "{new}"],
    "verify": ["{folder}"],
    "robot run": ["{folder}"],
    "robot calibrate": ["--to", "{new}"],
}

#: Of options with a grammar of their own.
WRONG = {
    "--seeds": ["nan", "-1", "0-", "5-3", "1,5-3", "1.5", "0-99999999999", "0-4294967295", "", "²"],
    "--set": ["reward=nan", "noise=inf", "noise=-1", "steps=many", "steps=0", "steps=1e9",
              "noise=", "noise", "seed=1", "colour=1", "world=mars", "colors=RX", "sequence=RR",
              "width=1", "learning_rate=1e300", "noise=5,nan"],
    "--ray": ["127.0.0.1:1", "127.0.0.1:99999", "a..b:5", "x", "", "{deaf}"],
    "--fault": ["stall=nan", "stall=inf", "stall=-1", "stall=2", "stall", "fire=1", "drop=x", ""],
    "--connect": ["tcp://127.0.0.1:99999", "tcp://127.0.0.1:0", "tcp://127.0.0.1:²", "tcp://a..b:5",
                  "tcp://127.0.0.1:-1", "tcp://", "serial://", "10.0.0.1", "http://a", "",
                  "tcp://h:1:2"],
    "--host": ["a..b", "", "a" * 70],
    "--colors": ["RX", "R", "RR", "", "R" * 1000],
    "--lines": ["", ";", "a;;b"],
    "--missing": ["X", "BB", "b", "B,Y"],
    "--then": ["GX", "G", "GG", "GB" * 1000],
    "--sequence": ["GX", "G", "GG", "", "GB" * 1000],
}  # fmt: skip

#: Options whose values are tried with a package that is not there on every Python.
PACKAGES = {"--ray": ["ray"]}

REMEDY = re.compile(r"[:;,] (give|choose|name|put|use|run|wait|make) |is not one of|, or name ")

NO_FOLDERS = ["/proc/x", "{file}", "{file}/x", "", "a" * 300, "a\0b"]
NO_FILES = ["/proc/x", "{folder}", "{file}/x", "{folder}/none/x", "", "a" * 300, "a\0b"]


def commands(group: click.Group = dntorch, path: str = "") -> Iterator[tuple[str, click.Command]]:
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{path}{name} ")
        else:
            yield f"{path}{name}", command


def wrong_values(param: click.Parameter) -> list[str]:
    """Values that an option may not have, by its kind."""
    kind = param.type
    if isinstance(kind, click.Choice):
        return ["nonesuch", "nan", ""]
    if isinstance(kind, Number):
        low, high = kind.within.least, kind.within.most
        values = ["nan", "inf", "-inf", "1e999", "x", "", "²", "9" * 20, "9" * 5000, "0x10"]
        values += [str(low - 1), str(high + 1), "-1e300", "1e300"]
        values += [str(low)] if kind.within.above else []
        return values + (["1.5", "1e3"] if kind.within.whole else [])
    if isinstance(kind, Place):
        there = kind.cannot == "cannot be read"
        return [*(NO_FILES if kind.dir_okay is False else NO_FOLDERS), *(["none"] if there else [])]
    assert isinstance(kind, Parsed), f"{param.opts}: give it a kind of dntorch.commands.kinds"
    return WRONG[param.opts[0]]


def cases() -> list:
    found = []
    for path, command in commands():
        for param in command.params:
            if not getattr(param, "is_flag", False):
                name, marks = param.opts[0], needs(*PACKAGES.get(param.opts[0], []))
                found += [
                    pytest.param(
                        path, param, value, id=f"{path} {name} {value[:20]!r}", marks=marks
                    )
                    for value in wrong_values(param)
                ]
    return found


@pytest.fixture
def place(tmp_path: Path, monkeypatch) -> Iterator[dict[str, str]]:
    """What the wrong values name; whoever begins to compute, fails the test."""
    begun = "the command began to work"
    monkeypatch.setattr(common, "settle", lambda: pytest.fail(begun))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("no image, no calibration")
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        monkeypatch.setattr("dntorch.commands.cluster.PATIENCE", 0.2)
        address = f"127.0.0.1:{deaf.getsockname()[1]}"
        yield {"folder": "folder", "file": "file", "new": "new", "deaf": address}


def refused(arguments: list[str]) -> str:
    """The one line with which the program refuses its arguments, and does nothing."""
    before = sorted(Path().rglob("*"))
    done = CliRunner().invoke(dntorch, arguments)
    assert done.exit_code == 2, (done.output, done.exception)
    assert done.stdout == "" and len(done.stderr.splitlines()) == 1, done.output
    assert sorted(Path().rglob("*")) == before
    return done.stderr


@pytest.mark.parametrize(("path", "param", "value"), cases())
def test_a_wrong_value_is_refused_by_name(path: str, param, value: str, place) -> None:
    value = value.format(**place)
    given = [text.format(**place) for text in NEEDED.get(path, [])]
    if isinstance(param, click.Argument):
        given, label = [value, *given[1:]], param.human_readable_name
        given = [*given, "--to", "new"] if "calibrate" in path else given
    elif param.opts[0] in given:
        given[given.index(param.opts[0]) + 1], label = value, param.opts[0]
    else:
        given, label = [*given, param.opts[0], value], param.opts[0]
    error = refused([*path.split(), *given])
    assert label in error and value[:100].replace("\0", "") in error.replace("\0", "")
    assert REMEDY.search(error), error


@pytest.mark.parametrize("path", [path for path, _ in commands()])
def test_switches_take_no_value(path: str, place) -> None:
    command = dict(commands())[path]
    given = [text.format(**place) for text in NEEDED.get(path, [])]
    for param in command.params:
        if getattr(param, "is_flag", False) and not param.is_eager:
            assert param.opts[0] in refused([*path.split(), *given, f"{param.opts[0]}=5"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("sweep --set noise=5 --set noise=6", ["--set noise", "twice", "give NAME=VALUE,VALUE"]),
        ("emulate --fault drop=.1 --fault drop=.2", ["--fault drop", "twice", "give one"]),
        ("emulate --fault drop=.6 --fault stall=.6", ["drop=0.6", "sum to at most 1"]),
        ("sweep --slurm", ["--slurm", "sbatch", "leave --slurm out"]),
        ("learn --nonesuch", ["--nonesuch", "See dntorch learn --help"]),
        ("learn nonesuch", ["nonesuch", "See dntorch learn --help"]),
        ("nonesuch", ["nonesuch", "See dntorch --help"]),
        ("learn --steps", ["--steps", "See dntorch --help"]),
        ("robot calibrate", ["--to"]),
    ],
)
def test_what_is_wrong_together_is_one_line(arguments: str, words: list[str], place, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    error = refused(arguments.split())
    assert all(word in error for word in words), error


def test_seeds_of_later_runs_are_seeds_too(place, monkeypatch) -> None:
    monkeypatch.setattr(common, "settle", lambda: None)
    error = refused(["reproduce", "--world", "ring", "--seed", str(2**32 - 5), "--runs", "10"])
    assert "--seed=4294967291" in error and "--runs=10" in error and "give a smaller one" in error


def test_too_little_memory_is_one_line(place, monkeypatch) -> None:
    def take(*_) -> None:
        raise MemoryError("Unable to allocate 9 TiB")

    monkeypatch.setattr(common, "settle", take)
    error = refused(["learn", "--world", "nodes"])
    assert "9 TiB" in error and "ask for fewer" in error

"""Options that are made from `Config`, files that hold their values, help and completion."""

import json
import os
import subprocess
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path

import click
import pytest

from dntorch.cli import main
from dntorch.commands import dntorch as group
from dntorch.commands.options import build_config, options_of_a_run, spelled
from dntorch.commands.reproduce import OTHER_TASKS
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.run import Trial
from dntorch.runs.settings import read_settings

QUICK = ["--world", "nodes", "--steps", "40", "--explore", "30"]


@click.command()
@options_of_a_run(seed=1)
def show(file, **options) -> Config:
    return build_config(file, options)


def config_of(*arguments: object) -> Config:
    return show.main(list(map(str, arguments)), standalone_mode=False)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def fails(monkeypatch, capsys, *arguments: object) -> str:
    """The one line on standard error with which a command refuses its arguments."""
    monkeypatch.setattr(sys, "argv", ["dntorch", *map(str, arguments)])
    with pytest.raises(SystemExit) as exit:
        main()
    assert exit.value.code == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1, error
    return error


# ------------------------------------------------------------------ options


@pytest.mark.parametrize("name", ["learn", "reproduce", "sweep"])
def test_each_field_is_an_option(name: str) -> None:
    left_out = {"sweep": {"seed"}, "reproduce": set(OTHER_TASKS)}.get(name, set())
    options = {p.name: p for p in group.commands[name].params}
    for field in fields(Config):
        assert (field.name in options) == (field.name not in left_out)
        if field.name in options:
            assert options[field.name].opts == ["--" + field.name.replace("_", "-")]
            assert options[field.name].help == field.metadata["help"] != ""


def test_without_options_it_is_the_config_of_the_library() -> None:
    assert config_of() == Config(seed=1)


def test_options_make_a_config_and_a_config_makes_options() -> None:
    config = Config(
        world="nodes", seed=7, explore=5, steps=9, sequence="RG", colors="RGB", dt=0.02, substeps=2,
        integrator="heun", learning_rate=0.1, trace_tau=0.5, reward=-1.5, reward_duration=0.25,
        noise=3.0, width=8, height=6, pulse_tau=0.3, dwell=0.7, recall=1, habituation=2,
        recovery=60.0, patience=9.0, constraints=3.0, curiosity=2.0, then="GR", change=4,
        missing="B",
    )  # fmt: skip
    assert all(value != getattr(Config(), name) for name, value in vars(config).items())
    assert config_of(*spelled(config, seed=1).split()) == config
    assert spelled(Config()) == ""


# ------------------------------------------------------------------ files


def test_of_a_short_run_half_is_exploration_unless_it_is_said() -> None:
    assert config_of("--steps", 2000).explore == 1000
    assert config_of("--steps", 200_000).explore == 50_000
    with pytest.raises(ValueError, match="explore=60 is not within steps=50"):
        config_of("--steps", 50, "--explore", 60)


def test_a_file_of_a_run_gives_its_options_and_the_command_line_wins(tmp_path: Path) -> None:
    config = Config(world="nodes", seed=5, noise=4.0, trace_tau=0.7)
    file = write(tmp_path / "results.json", json.dumps({"seed": 99, "config": asdict(config)}))
    assert config_of("--config", file) == config
    for arguments in (["--noise", 6, "--config", file], ["--config", file, "--noise", 6]):
        assert config_of(*arguments) == replace(config, noise=6.0)


def test_a_toml_file_holds_some_options(tmp_path: Path) -> None:
    pytest.importorskip("tomllib" if sys.version_info >= (3, 11) else "tomli")
    file = write(tmp_path / "a.toml", 'noise = 5  # whole\nintegrator = "heun"\nexplore = 7\n')
    assert config_of("--config", file) == Config(seed=1, noise=5.0, integrator="heun", explore=7)
    assert isinstance(read_settings(file)["noise"], float)


def test_toml_without_its_reader_is_one_sentence(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "tomllib", None)
    monkeypatch.setitem(sys.modules, "tomli", None)
    with pytest.raises(ValueError, match=r"a\.toml cannot be used \(TOML needs Python 3\.11"):
        read_settings(write(tmp_path / "a.toml", "noise = 5"))


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("none.json", None, ["none.json", "cannot be read", "name another"]),
        ("a.json", "{", ["a.json", "give the results.json of a run"]),
        ("a.json", '{"noise": 5.0}', ["a.json", "no config", "give the results.json of a run"]),
        ("a.json", '{"config": {"volume": 3}}', ["a.json", "volume=3", "take it out", "noise"]),
        ("a.json", '{"config": {"noise": "x"}}', ["a.json", "noise='x'", "give a number"]),
        ("a.json", '{"config": {"steps": 1.5}}', ["steps=1.5", "give a whole number"]),
        ("a.json", '{"config": {"seed": true}}', ["seed=True", "give a whole number"]),
        ("a.json", '{"config": {"dt": null}}', ["dt=None", "give a number"]),
        ("a.json", '{"config": {"colors": 3}}', ["colors=3", "give a text"]),
        ("a.json", '{"config": {"world": "mars"}}', ["world='mars'", "epuck, ring, nodes"]),
        ("a.json", '{"config": {"dt": -1.0}}', ["a.json", "dt=-1.0", "give a number from 0.001"]),
    ],
)
@pytest.mark.parametrize("command", ["learn", "reproduce", "sweep"])
def test_a_bad_file_is_one_line(
    command: str, name: str, text: str | None, words: list[str], tmp_path, monkeypatch, capsys
) -> None:
    if text is not None:
        write(tmp_path / name, text)
    out = tmp_path / "out"
    error = fails(monkeypatch, capsys, command, "--config", tmp_path / name, "--out", out)
    assert all(word in error for word in words), error
    assert not out.exists()


# ------------------------------------------------------------------ an autonomous agent


def test_autonomous_is_a_set_of_numbers_above_a_file_below_the_command_line(tmp_path: Path) -> None:
    """The file of a run names every number: below it the set would be without effect."""
    pytest.importorskip("tomllib" if sys.version_info >= (3, 11) else "tomli")
    plain = Config(seed=1, steps=900, explore=900, **AUTONOMOUS)
    assert config_of("--autonomous", "--steps", 900) == plain
    file = write(tmp_path / "a.toml", "noise = 0.3\npatience = 9.0\nreward = 3.0\n")
    for words in (["--autonomous", "--config", file], ["--config", file, "--autonomous"]):
        read = config_of(*words, "--steps", 900, "--patience", 7)
        assert read == replace(plain, reward=3.0, patience=7.0)
    assert config_of("--config", file, "--steps", 900).habituation == Config.habituation


def test_an_autonomous_agent_explores_as_long_as_it_runs_unless_it_is_said(tmp_path: Path) -> None:
    assert config_of("--autonomous").explore == Config.steps
    assert config_of("--autonomous", "--steps", 200_000).explore == 200_000
    assert config_of("--autonomous", "--steps", 900, "--explore", 50).explore == 50
    file = write(tmp_path / "a.json", '{"config": {"steps": 900, "explore": 70}}')
    assert config_of("--autonomous", "--config", file).explore == 900


PARTS = ["--autonomous", "--recall", 1, "--curiosity", 2, "--missing", "B",
         "--sequence", "GYRG", "--then", "YRGY", "--change", 20]  # fmt: skip


def test_learn_makes_an_autonomous_agent_with_parts(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "a"
    arguments = ["learn", "--world", "nodes", "--steps", 40, *PARTS, "--no-compile", "--out", out]
    monkeypatch.setattr(sys, "argv", ["dntorch", *map(str, arguments)])
    with pytest.raises(SystemExit) as exit:
        main()
    assert not exit.value.code
    wanted = Config(
        world="nodes", seed=1, steps=40, explore=40, recall=1, curiosity=2.0,
        missing="B", sequence="GYRG", then="YRGY", change=20, **AUTONOMOUS,
    )  # fmt: skip
    agent = Trial.load(out / "checkpoint.pt").agent
    assert json.loads((out / "results.json").read_text())["config"] == asdict(wanted)
    assert agent.learner.states == 16 and agent.senses == ("match", "lamp")
    assert (out / "report.html").exists()


def test_a_sweep_of_lengths_explores_each_as_one_run_does(tmp_path: Path, monkeypatch) -> None:
    for name, more, explored in (("a", ["--autonomous"], [30, 20]), ("b", [], [15, 10])):
        monkeypatch.setattr(sys, "argv", [
            "dntorch", "sweep", "--world", "nodes", *more, "--seeds", "3", "--set", "steps=30,20",
            "--processes", "1", "--out", str(tmp_path / name),
        ])  # fmt: skip
        with pytest.raises(SystemExit) as exit:
            main()
        assert not exit.value.code
        lines = (tmp_path / name / "table.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        assert [row["explore"] for row in rows] == explored
        assert [row["noise"] for row in rows] == [AUTONOMOUS["noise"] if more else Config.noise] * 2


@pytest.mark.parametrize("option", ["--autonomous", "--recall=1", "--then=RBGYR", "--missing=B"])
def test_reproduce_has_no_option_that_its_claims_do_not_know(
    option: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    error = fails(monkeypatch, capsys, "reproduce", option, "--out", tmp_path / "r")
    assert option.partition("=")[0] in error and not (tmp_path / "r").exists()


def test_the_set_is_of_a_new_run(tmp_path: Path, monkeypatch, capsys) -> None:
    error = fails(monkeypatch, capsys, "learn", "--resume", tmp_path, "--autonomous")
    assert "leave --autonomous out" in error


CONTRADICTIONS = {
    "then": (["--then", "GYRG"], ["then='GYRG'", "change=0", "give both"]),
    "change": (["--change", "20"], ["then=''", "change=20", "give both"]),
    "length": (["--then", "GYG", "--change", "20"], ["then=GYG", "as long as sequence=GBYRG"]),
    "repeated": (["--then", "GGYRG", "--change", "20"], ["GGYRG"]),
    "colour": (["--then", "GVYRG", "--change", "20"], ["V", "RGBY"]),
    "missing": (["--missing", "V"], ["missing='V'", "colors='RGBY'"]),
    "all missing": (["--missing", "RGB"], ["missing='RGB'", "leave at least two"]),
    "constraints": (["--constraints", "20"], ["constraints=20.0", "give patience"]),
    "patience": (["--patience", "0.01"], ["patience=0.01", "dt=0.03125"]),
    "recovery": (["--recovery", "0.01"], ["recovery=0.01", "dt=0.03125"]),
    "pulses": (["--pulse-tau", "0.01"], ["pulse_tau=0.01", "dt=0.03125"]),
    "habituation": (
        ["--colors", "ROYGCBVM", "--sequence", "ROY", "--habituation", "8"],
        ["order=8", "at most order=6"],
    ),
    "explore": (["--autonomous", "--explore", "50", "--steps", "40"], ["explore=50", "steps=40"]),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
@pytest.mark.parametrize("command", ["learn", "sweep"])
def test_values_that_contradict_each_other_are_one_line(
    command: str, name: str, tmp_path, monkeypatch, capsys
) -> None:
    (arguments, words), out = CONTRADICTIONS[name], tmp_path / "out"
    error = fails(monkeypatch, capsys, command, "--world", "ring", *arguments, "--out", out)
    assert all(word in error for word in words), error
    assert not out.exists()


# ------------------------------------------------------------------ commands


@pytest.mark.parametrize("command", ["learn", "reproduce", "sweep"])
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--dt", "0.2"], ["dt=0.2", "smaller dt"]),
        (["--trace-tau", "0"], ["--trace-tau=0", "give a number above 0"]),
        (["--reward", "nan"], ["reward=nan", "give a number"]),
        (["--reward-duration", "0.01"], ["reward_duration=0.01", "give at least dt=0.03125"]),
        (["--noise", "loud"], ["--noise", "loud"]),
        (["--integrator", "rk4"], ["rk4", "euler"]),
        (["--width", "0"], ["--width=0", "give a whole number from 8"]),
        (["--colors", "RGBX"], ["RGBX", "ROYGCBVM"]),
    ],
)
def test_bad_values_are_one_line_and_leave_nothing(
    command: str, arguments: list[str], words: list[str], tmp_path, monkeypatch, capsys
) -> None:
    out = tmp_path / "out"
    error = fails(monkeypatch, capsys, command, "--world", "ring", *arguments, "--out", out)
    assert all(word in error for word in words), error
    assert not out.exists()


def test_learn_uses_all_of_them(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", [
        "dntorch", "learn", *QUICK, "--noise", "3", "--reward", "1.5", "--trace-tau", "0.5",
        "--reward-duration", "0.5", "--out", str(tmp_path / "a"),
    ])  # fmt: skip
    with pytest.raises(SystemExit) as exit:
        main()
    assert not exit.value.code
    results = json.loads((tmp_path / "a" / "results.json").read_text())
    wanted = Config(
        world="nodes", steps=40, explore=30, seed=1, noise=3.0, reward=1.5, trace_tau=0.5,
        reward_duration=0.5,
    )  # fmt: skip
    assert results["config"] == asdict(wanted)
    assert Trial.load(tmp_path / "a" / "checkpoint.pt").config == wanted


def test_a_sweep_varies_a_run_from_a_file(tmp_path: Path, monkeypatch) -> None:
    base = Config(world="nodes", seed=77, steps=40, explore=30, reward=1.5)
    file = write(tmp_path / "results.json", json.dumps({"config": asdict(base)}))
    monkeypatch.setattr(sys, "argv", [
        "dntorch", "sweep", "--config", str(file), "--noise", "4", "--seeds", "3,5",
        "--set", "trace_tau=0.5,0.8", "--set", "steps=20", "--explore", "10", "--batch", "8",
        "--processes", "1", "--out", str(tmp_path / "s"),
    ])  # fmt: skip
    with pytest.raises(SystemExit) as exit:
        main()
    assert not exit.value.code
    rows = [json.loads(line) for line in (tmp_path / "s" / "table.jsonl").read_text().splitlines()]
    assert [(row["trace_tau"], row["seed"]) for row in rows] == [
        (0.5, 3), (0.5, 5), (0.8, 3), (0.8, 5),
    ]  # fmt: skip
    for row in rows:
        assert (row["noise"], row["reward"], row["steps"]) == (4.0, 1.5, 20)


def test_one_value_has_one_source(tmp_path: Path, monkeypatch, capsys) -> None:
    out = ["--out", tmp_path / "s"]
    error = fails(monkeypatch, capsys, "sweep", "--noise", 3, "--set", "noise=4,5", *out)
    assert "--noise" in error and "leave --noise out" in error
    error = fails(monkeypatch, capsys, "learn", "--resume", tmp_path, "--trace-tau", 1)
    assert "leave --trace-tau out" in error
    file = write(tmp_path / "a.json", '{"config": {}}')
    error = fails(monkeypatch, capsys, "learn", "--resume", tmp_path, "--config", file)
    assert "leave --config out" in error


# ------------------------------------------------------------------ help and completion


def test_without_a_command_the_help_is_shown_as_it_stands(monkeypatch, capsys) -> None:
    for arguments in ([], ["robot"]):
        monkeypatch.setattr(sys, "argv", ["dntorch", *arguments])
        with pytest.raises(SystemExit) as exit:
            main()
        assert exit.value.code == 2 and len(capsys.readouterr().err.splitlines()) > 5


def test_a_package_that_is_missing_is_one_line(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    error = fails(monkeypatch, capsys, "learn", *QUICK, "--out", tmp_path / "run")
    assert "tqdm" in error and "pip install" in error


LISTS_MODULES = """
import atexit, sys
from dntorch.cli import main
heavy = "torch", "numpy", "gymnasium", "scipy", "matplotlib"
atexit.register(lambda: print(*(name for name in heavy if name in sys.modules), file=sys.stderr))
sys.argv = ["dntorch", *sys.argv[1:]]
main()
"""


def light(*arguments: str, **environment: str) -> str:
    """What the command line prints when it may import nothing heavy."""
    done = subprocess.run(
        [sys.executable, "-c", LISTS_MODULES, *arguments],
        capture_output=True, text=True, env=os.environ | environment,
    )  # fmt: skip
    assert done.stderr.strip() == "" and done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("arguments", [
    "--help", "-h", "--version", "learn --help", "reproduce -h", "sweep -h", "export -h",
    "verify -h", "robot -h", "robot run -h", "robot calibrate -h", "emulate -h",
])  # fmt: skip
def test_help_imports_nothing_heavy(arguments: str) -> None:
    assert "dntorch" in light(*arguments.split())


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("dntorch le", "plain,learn"),
        ("dntorch learn --tr", "plain,--trace-tau"),
        ("dntorch learn --world n", "plain,nodes"),
        ("dntorch sweep --integrator h", "plain,heun"),
    ],
)
def test_completion_imports_nothing_heavy(words: str, found: str) -> None:
    count = str(len(words.split()) - 1)
    environment = {"COMP_WORDS": words, "COMP_CWORD": count}
    assert light(**environment, _DNTORCH_COMPLETE="bash_complete").split() == [found]


def test_completion_has_a_script_for_the_shell() -> None:
    assert "_DNTORCH_COMPLETE=zsh_complete" in light(_DNTORCH_COMPLETE="zsh_source")

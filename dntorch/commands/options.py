"""Options that are made from the fields of `Config`."""

from collections.abc import Callable, Mapping
from dataclasses import Field
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from dntorch.colors import HUES, check_colors, check_missing, check_sequence
from dntorch.commands.kinds import OLD_FILE, Number, Parsed, whole
from dntorch.runs.config import AUTONOMOUS, FIELDS, LONGEST, Config, check_setting
from dntorch.runs.settings import read_settings


def options_of_a_run(
    without: tuple[str, ...] = (), autonomous: bool = True, **defaults: Any
) -> Callable:
    """Decorate a command with ``--config`` and an option for each field of `Config`.

    Args:
        without: fields that are no option of the command.
        autonomous: whether there is ``--autonomous``.
        defaults: of the command, where they differ from those of `Config`.
    """

    def decorate(function: Callable) -> Callable:
        for name, field in reversed(FIELDS.items()):
            if name not in without:
                function = _option(field, defaults.get(name, field.default))(function)
        function = _FILE(function)
        return _AUTONOMOUS(function) if autonomous else function

    return decorate


def build_config(file: Path | None, values: Mapping[str, Any]) -> Config:
    """The config of a run whose options came from the command line and from ``file``.

    Of a run shorter than the default exploration, half is exploration unless it was said. An
    autonomous one has no phases: all of it is.
    """
    own = {name: values[name] for name in FIELDS if name in values}
    autonomous = bool(values.get("autonomous"))
    if exploration_is_open(autonomous):
        own["explore"] = explored(own["steps"], autonomous)
    try:
        config = Config(**own)
    except ValueError as error:
        if file is None:
            raise
        raise ValueError(f"{error} (with --config {file})") from error
    if autonomous:
        used = {name: own[name] for name in (*AUTONOMOUS, "explore")}
        click.echo(f"autonomous: {_as_options(used)}", err=True)
    return config


def exploration_is_open(autonomous: bool) -> bool:
    """Whether neither the command line nor a file, which an autonomous run overrules, says how
    long to explore."""
    context = click.get_current_context(silent=True)
    source = context and context.get_parameter_source("explore")
    said_by = (ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP)
    return source in said_by if autonomous else source is ParameterSource.DEFAULT


def explored(steps: int, autonomous: bool) -> int:
    """Control steps of exploration of a run that leaves them open."""
    usual = Config.explore
    return steps if autonomous else usual if usual <= steps else steps // 2


def spelled(config: Config, **defaults: Any) -> str:
    """The options that make ``config`` in a command with these defaults.

    >>> spelled(Config(noise=5.0, world="nodes"), world="nodes")
    '--noise 5.0'
    """
    usual = vars(Config()) | defaults
    return _as_options({k: value for k, value in vars(config).items() if value != usual[k]})


def _as_options(values: Mapping[str, Any]) -> str:
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in values.items())


def _option(field: Field, default: Any) -> Callable:
    return click.option(
        "--" + field.name.replace("_", "-"),
        type=kind_of(field),
        default=default,
        show_default=True,
        help=field.metadata["help"],
    )


def kind_of(field: Field) -> click.ParamType:
    """What an option for a field takes."""
    choices, within = field.metadata["choices"], field.metadata["within"]
    if choices:
        return click.Choice(choices)
    return Number(within) if within else LETTERS[field.name]


def _colors(text: str) -> str:
    check_setting("colors", text)
    return check_colors(text)


def _sequence(text: str) -> str:
    check_setting("sequence", text)
    return check_sequence(text, "".join(HUES))  # of these colours: once they are known


def _none_or(parse: Callable[[str], str]) -> Parsed:
    return Parsed(lambda text: parse(text) if text else "")


COLORS, MISSING = Parsed(_colors), Parsed(check_missing)
LETTERS = {
    "colors": COLORS, "sequence": Parsed(_sequence), "then": _none_or(_sequence),
    "missing": MISSING,
}  # fmt: skip


def _take_defaults(context: click.Context, _: click.Parameter, file: Path | None) -> Path | None:
    if file is not None:
        context.default_map = {**read_settings(file), **(context.default_map or {})}
    return file


def _take_set(context: click.Context, _: click.Parameter, on: bool) -> bool:
    """The set of an autonomous agent, above what a file says: a run's file says everything."""
    if on:
        context.default_map = {**(context.default_map or {}), **AUTONOMOUS}
    return on


_AUTONOMOUS = click.option(
    "--autonomous",
    is_flag=True,
    is_eager=True,
    callback=_take_set,
    help=f"An agent without phases: {_as_options(AUTONOMOUS)}, and --explore as long as --steps.",
)


COMPILE = click.option(
    "--compile/--no-compile",
    "compiled",
    default=True,
    show_default=True,
    help="Compile the step where a run is long and a C++ compiler is there.",
)

CHECKPOINT_EVERY = click.option(
    "--checkpoint-every",
    type=whole(1, LONGEST),
    default=5_000,
    show_default=True,
    help="Control steps between two checkpoints.",
)

_FILE = click.option(
    "--config",
    "file",
    type=OLD_FILE,
    is_eager=True,  # before those whose defaults it holds
    callback=_take_defaults,
    help="results.json of a run, or a TOML file (noise = 5.0): values of the options below.",
)

"""The command line: one file per command.

No file imports PyTorch or NumPy before its command runs: help and completion answer at once.
"""

import click

import dntorch as library
from dntorch.commands.beyond import beyond
from dntorch.commands.emulate import emulate
from dntorch.commands.export import export, verify
from dntorch.commands.learn import learn
from dntorch.commands.program import Program
from dntorch.commands.reproduce import reproduce
from dntorch.commands.robot import robot
from dntorch.commands.sweep import sweep


def _print_version(context: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked and not context.resilient_parsing:
        click.echo(f"dntorch, version {library.__version__}")
        context.exit()


@click.group(
    cls=Program,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the version and exit.",
)
def dntorch() -> None:
    """Neural dynamics that learn behaviour."""


for command in (learn, reproduce, beyond, sweep, export, verify, robot, emulate):
    dntorch.add_command(command)

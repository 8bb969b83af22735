"""The command line: one file a command."""

import click

import dntorch as library
from dntorch.commands.emulate import emulate
from dntorch.commands.export import export, verify
from dntorch.commands.learn import learn
from dntorch.commands.reproduce import reproduce
from dntorch.commands.robot import robot
from dntorch.commands.sweep import sweep
from dntorch.process import settle


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(library.__version__)
def dntorch() -> None:
    """Neural dynamics that learn behaviour."""
    settle()


for command in (learn, reproduce, sweep, export, verify, robot, emulate):
    dntorch.add_command(command)

"""The command line: one file a command."""

import click
import torch

import dntorch as library
from dntorch.commands.emulate import emulate
from dntorch.commands.export import export, verify
from dntorch.commands.learn import learn
from dntorch.commands.reproduce import reproduce
from dntorch.commands.robot import robot
from dntorch.commands.sweep import sweep


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(library.__version__)
def dntorch() -> None:
    """Neural dynamics that learn behaviour."""
    # Settings of the process: silent cells must not decay into slow denormal numbers, and
    # operations on a few nodes are fastest, and always the same, on one thread.
    torch.set_flush_denormal(True)
    torch.set_num_threads(1)


for command in (learn, reproduce, sweep, export, verify, robot, emulate):
    dntorch.add_command(command)

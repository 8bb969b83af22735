"""What several commands do."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dntorch.process import end_when_asked, postponed, settle

if TYPE_CHECKING:
    from tqdm import tqdm


class Computing(click.Command):
    """A command that computes: its process gets its settings before anything else.

    Not the group: it runs before ``--help`` of a command, and would import PyTorch for it.
    """

    def invoke(self, context: click.Context) -> Any:
        settle()
        return super().invoke(context)


def refuse_options(context: click.Context, kept: Iterable[str], why: str) -> None:
    """Raise if an option was given that is not among the ``kept``; ``why`` names the remedy."""
    for name in context.params.keys() - set(kept):
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            option = {p.name: p.opts[0] for p in context.command.params}[name]
            raise ValueError(f"{option} {why}: leave {option} out")


MOST_RUNS, MOST_PROCESSES = 100_000, 1024

RUNS = ("checkpoint.pt", "options.pt", "results.json")
"""Files by which a folder is known to hold runs."""

OF_A_RUN = "cannot be given with --resume, which keeps the options it began with"


def new_folder(folder: Path, marks: Iterable[str], remedy: str = "name another --out") -> Path:
    """Make a folder for a run; one that holds a file of ``marks`` is another run's."""
    if any((folder / mark).exists() for mark in marks):
        raise ValueError(f"--out={folder} holds a run already: {remedy}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"--out={folder} cannot be made ({error.strerror}): name another"
        ) from error
    if not os.access(folder, os.W_OK):
        raise ValueError(f"--out={folder} cannot be written to: name another folder")
    return folder


@contextmanager
def stoppable(remedy: str) -> Iterator[None]:
    """Inside the block any request to end ends it as Ctrl-C does, and the remedy is printed."""
    end_when_asked()
    try:
        yield
    except KeyboardInterrupt:
        click.echo(f"stopped; {remedy}", err=True)
        raise


@contextmanager
def progress_bar(**counting: Any) -> "Iterator[tqdm]":
    """A progress bar; in a log file it has few lines."""
    from tqdm import tqdm

    counting = {"mininterval": 0.1 if sys.stderr.isatty() else 20.0} | counting
    with postponed():  # one that is half made cannot be closed
        bar = tqdm(**counting)
    with bar:
        yield bar

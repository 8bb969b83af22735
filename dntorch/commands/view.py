"""The command that opens a page of something that runs."""

import sys
from pathlib import Path

import click

from dntorch.commands.common import Computing, stoppable
from dntorch.commands.kinds import HOST, Parsed, whole
from dntorch.extras import require


def _there(text: str) -> Path:
    path = Path(text)
    try:
        path.lstat()
        there = text != ""
    except (OSError, ValueError):  # the latter of a text that is no path
        there = False
    if not there:
        raise ValueError("it is not there: name a COSIVINA file or the folder of a run")
    return path


@click.command(cls=Computing)
@click.argument("target", type=Parsed(_there, "path"))
@click.option(
    "--host", type=HOST, default="127.0.0.1", show_default=True,
    help="Where to listen; who reaches it can use the page.",
)  # fmt: skip
@click.option("--port", type=whole(0, 65535), default=0, help="TCP port.  [default: a free one]")
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open it, too.")
def view(target: Path, host: str, port: int, browser: bool) -> None:
    """Watch TARGET run, on a page in the browser, and turn its parameters.

    TARGET is a COSIVINA parameter file (JSON), the folder of a run or its checkpoint. The page
    shows activation, output and input of fields; click into one to put an input there. Of a run it
    shows camera, robot, fields, nodes and values, and key r gives the reward by hand; the files of
    the run are only read. Ctrl-C ends it.
    """
    require("bokeh", "numpy")
    from dntorch.live.serving import view as open_view

    with stoppable("the same command opens it again"):
        page = open_view(target, host, port, browser)
        click.echo(f"{target} at {page.url}")
        sys.stdout.flush()
        try:
            page.wait()
        finally:
            page.stop()

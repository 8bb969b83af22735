"""The command that serves an emulated robot."""

import sys
import time
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

import click

from dntorch.colors import PAPER
from dntorch.commands.common import Computing, progress_bar, refuse_options
from dntorch.commands.kinds import HOST, whole
from dntorch.commands.options import COLORS, MISSING
from dntorch.commands.target import CAMERA, FAULT, LAYOUT, PACING, PROTOCOL, build_emulator
from dntorch.extras import require
from dntorch.process import end_when_asked

if TYPE_CHECKING:
    from dntorch.robot.emulated.emulator import Emulator
    from dntorch.robot.emulated.servers import Server


@click.command(cls=Computing)
@PROTOCOL
@PACING
@CAMERA
@FAULT
@LAYOUT
@click.option(
    "--colors",
    type=COLORS,
    default=PAPER,
    show_default=True,
    help="Of the blocks around it, of ROYGCBVM.",
)
@click.option(
    "--missing",
    type=MISSING,
    default="",
    help="Colors that no block has; in their places stand others.",
)
@click.option("--host", type=HOST, default="127.0.0.1", show_default=True, help="Where to listen.")
@click.option("--port", type=whole(0, 65535), default=0, help="TCP port.  [default: a free one]")
@click.option("--pty", is_flag=True, help="A pseudo-terminal instead of a TCP port.")
@click.pass_context
def emulate(
    context: click.Context,
    host: str,
    port: int,
    pty: bool,
    colors: str,
    missing: str,
    **options: Any,
) -> None:
    """Serve an emulated e-puck in its ring of blocks.

    As with the real one, nothing stops the motors but a command. Ctrl-C ends it.
    """
    require("tqdm", "numpy", "gymnasium")
    if pty:
        others = context.params.keys() - {"host", "port"}
        refuse_options(context, others, "is of TCP, but --pty serves a pseudo-terminal")
    end_when_asked()
    from dntorch.envs.layout import Ring
    from dntorch.envs.task import SequenceTask

    task = SequenceTask(colors[:2], colors)  # nobody sees what is rewarded there
    world = {"task": task, "ring": Ring(4 * len(colors), missing=missing)}
    with closing(_server(host, port, pty)) as server:
        emulator = build_emulator(server, world=world, **options)
        with emulator, suppress(KeyboardInterrupt):
            click.echo(f"{options['protocol']} at {server.address}")
            sys.stdout.flush()
            _watch(emulator)
    counts = [f"{count} {name}" for name, count in emulator.faults.counts.items()]
    click.echo(f"{emulator.steps} steps, faults: {', '.join(counts) or 'none'}")


def _watch(emulator: "Emulator") -> None:
    with progress_bar(unit="step", mininterval=0.5, miniters=0) as bar:
        while True:
            left, right = emulator.speeds
            client = "connected" if emulator.connected else "none"
            bar.set_postfix_str(f"client: {client}, motors: {left} {right} steps/s", refresh=False)
            bar.update(emulator.steps - bar.n)
            time.sleep(0.1)


def _server(host: str, port: int, pty: bool) -> "Server":
    from dntorch.robot.emulated.servers import PtyServer, TcpServer

    if pty:
        return PtyServer()
    try:
        return TcpServer(host, port)
    except OSError as error:
        raise ValueError(
            f"--port={port} on --host={host}: {error.strerror}; name another, ports below 1024 "
            "need rights"
        ) from error

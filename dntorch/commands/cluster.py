"""Options that say who does the work of a sweep: a Ray cluster, a Slurm queue."""

import re
import shutil
import socket

import click

from dntorch.commands.kinds import Parsed
from dntorch.extras import require

PATIENCE = 3.0
"""s, for a cluster to answer."""
SETTINGS = bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""The frame with which both sides of HTTP/2 begin."""


def _ray(address: str) -> str:
    """The address of a cluster at which somebody answers: Ray would wait for long."""
    require("ray", instead="leave --ray out")
    from dntorch.robot.transports import PORTS

    if address in ("local", "auto"):
        return address
    place = re.fullmatch(r"(?:ray://)?([^:/\s]+):([0-9]{1,5})", address)
    try:
        if place is None:
            raise ValueError
        PORTS.check("port", port := int(place[2]))
        _greet(place[1], port)
    except OSError as error:
        raise ValueError(
            f"{error.strerror or error}; run ray start --head there, name another address, or local"
        ) from error
    except ValueError:  # UnicodeError too: a name that cannot be looked up
        raise ValueError("give HOST:PORT, ray://HOST:PORT, auto or local") from None
    return address


def _greet(host: str, port: int) -> None:
    """Raise an ``OSError`` unless who listens speaks HTTP/2, as Ray's gRPC does."""
    with socket.create_connection((host, port), PATIENCE) as link:
        link.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + SETTINGS)
        if link.recv(9)[3:4] != SETTINGS[3:4]:
            raise ConnectionError("whoever listens there is no Ray cluster")


def _slurm(_: click.Context, __: click.Parameter, asked: bool) -> bool:
    if asked:
        require("submitit", instead="leave --slurm out")
        if not shutil.which("sbatch"):  # submitit would run the jobs here, without a word
            raise ValueError(
                "--slurm: there is no sbatch here; run it where jobs are submitted to Slurm, or "
                "leave --slurm out"
            )
    return asked


RAY = click.option(
    "--ray",
    metavar="ADDRESS",
    type=Parsed(_ray),
    help="On a Ray cluster: its address, or local to start one here.",
)
SLURM = click.option(
    "--slurm", is_flag=True, callback=_slurm, help="As an array of Slurm jobs (submitit)."
)

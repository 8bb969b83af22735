"""Options that say who does the work of a sweep: a Ray cluster, a Slurm queue."""

import re
import shutil
import socket

import click

from dntorch.commands.extras import require
from dntorch.commands.kinds import Parsed
from dntorch.robot.transports import check_port

PATIENCE = 3.0
"""s, for a cluster to answer."""


def _ray(address: str) -> str:
    """The address of a cluster at which somebody answers: Ray would wait for long."""
    require("ray", instead="leave --ray out")
    if address in ("local", "auto"):
        return address
    place = re.fullmatch(r"(?:ray://)?([^:/\s]+):([0-9]{1,5})", address)
    try:
        if place is None:
            raise ValueError
        check_port(port := int(place[2]))
        socket.create_connection((place[1], port), PATIENCE).close()
    except OSError as error:
        raise ValueError(
            f"{error.strerror or error}; run ray start --head there, name another address, or local"
        ) from error
    except ValueError:  # UnicodeError too: a name that cannot be looked up
        raise ValueError("give HOST:PORT, ray://HOST:PORT, auto or local") from None
    return address


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

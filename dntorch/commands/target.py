"""What a command drives: a robot that was named, or an emulator; and options that say which."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from dntorch.commands.common import refuse_options
from dntorch.commands.kinds import Parsed, once, whole
from dntorch.extras import require

if TYPE_CHECKING:
    from dntorch.robot.clock import Clock
    from dntorch.robot.driver import Driver
    from dntorch.robot.emulated.emulator import Emulator
    from dntorch.robot.emulated.servers import Server
    from dntorch.runs.config import Config

PROTOCOL = click.option(
    "--protocol", type=click.Choice(("wifi", "sercom", "sercom2")), default="wifi",
    show_default=True, help="e-puck2 over Wi-Fi, e-puck1, e-puck2 over Bluetooth or USB.",
)  # fmt: skip
LAYOUT = click.option(
    "--seed", type=whole(0, 2**32 - 1), default=0, show_default=True,
    help="Of the emulator's layout, camera noise and faults.",
)  # fmt: skip
CAMERA = click.option(
    "--camera", type=click.Choice(("ideal", "mild", "hard")), default="mild", show_default=True,
    help="Of the emulator: as simulated; a fair one; dark, blurred, narrow, slow and late.",
)  # fmt: skip


def _fault(text: str) -> tuple[str, float]:
    from dntorch.robot.emulated.faults import Faults

    name, _, chance = text.partition("=")
    if name not in Faults().chances:
        raise ValueError(f"give NAME=CHANCE, NAME of {', '.join(Faults().chances)}")
    try:
        Faults(**{name: float(chance)})
    except ValueError:
        raise ValueError(f"give {name}=CHANCE, a number from 0 to 1") from None
    return name, float(chance)


def _together(_: click.Context, __: click.Parameter, given: tuple[tuple[str, float], ...]) -> Any:
    """Faults by name, each named once and all of them possible together."""
    if given:
        from dntorch.robot.emulated.faults import Faults

        once(given, "--fault", "give one chance")
        Faults(**dict(given))
    return dict(given)


FAULT = click.option(
    "--fault", "faults", multiple=True, metavar="NAME=CHANCE", type=Parsed(_fault),
    callback=_together,
    help="Of the emulator, for each set of packets: stall, delay, drop, truncate, split, "
    "duplicate, garbage or reset; may be given several times, each once.",
)  # fmt: skip
PACING = click.option(
    "--pacing", type=click.Choice(("firmware", "webots", "request")), default="firmware",
    show_default=True, help="Of the emulator: how it streams over Wi-Fi.",
)  # fmt: skip


OF_THE_EMULATOR = ("pacing", "camera", "faults", "seed", "virtual")
"""Parameters that a robot with an address has not."""


class Target(NamedTuple):
    """What is driven."""

    driver: "Driver"
    clock: "Clock"
    fov: float
    """rad, of its camera if nobody measured it"""
    emulator: "Emulator | None"
    seen: list[int]
    """colours that the world of an emulated one judged as found"""


def _address(text: str) -> str:
    """An address at which a robot may be, as it was given."""
    from dntorch.robot.transports import Serial, transport_for

    if isinstance(transport_for(text), Serial):
        require("serial")
    return text


def options_of_target(command):
    """Options that say what is driven."""
    for option in (
        click.option("--virtual", is_flag=True, help="Its own emulator, in simulated time."),
        LAYOUT, FAULT, CAMERA, PACING, PROTOCOL,
        click.option(
            "--connect", metavar="ADDRESS", type=Parsed(_address),
            help="tcp://HOST[:PORT] or serial://DEVICE.  [default: an emulator of its own]",
        ),
    ):  # fmt: skip
        command = option(command)
    return command


@contextmanager
def open_target(
    context: click.Context, config: "Config", *, connect: str | None, protocol: str, virtual: bool,
    reconnect: bool = False, **emulation: Any,
) -> Iterator[Target]:  # fmt: skip
    """The robot that was named, or an emulator that lives as long as it is driven."""
    from dntorch.envs.task import NOTHING
    from dntorch.robot.clock import RealClock, VirtualClock
    from dntorch.robot.dialects import DIALECTS
    from dntorch.robot.driver import Driver
    from dntorch.robot.emulated.camera import CAMERAS
    from dntorch.robot.emulated.emulator import BODIES
    from dntorch.robot.emulated.servers import MemoryServer, TcpServer
    from dntorch.robot.transports import transport_for
    from dntorch.runs.worlds import build_task

    clock, fov = VirtualClock() if virtual else RealClock(), BODIES[protocol].fov

    def driver(transport) -> Driver:
        return Driver(transport, DIALECTS[protocol](), clock, reconnect=reconnect)

    if connect:
        known = context.params.keys() - set(OF_THE_EMULATOR)
        refuse_options(context, known, "is of the emulator, but --connect names a robot")
        try:
            yield Target(driver(transport_for(connect)), clock, fov, None, [])
        except OSError as error:
            if error.filename:  # a file of ours, not the link
                raise
            ask = ": is it on, near and free?" if error.errno else ""
            raise ValueError(f"--connect={connect} --protocol={protocol}: {error}{ask}") from error
        return
    seen: list[int] = []

    def see(info: dict[str, Any]) -> None:
        if info["found"] != NOTHING:
            seen.append(int(info["found"]))

    task = {"task": build_task(config)}
    with closing(MemoryServer() if virtual else TcpServer()) as server:
        emulator = build_emulator(
            server, clock, protocol=protocol, world=task, on_step=see, **emulation
        )
        with closing(emulator.world), emulator:
            transport = server.transport() if virtual else transport_for(server.address)
            fov = CAMERAS[emulation["camera"]].fov(fov)
            yield Target(driver(transport), clock, fov, emulator, seen)


def build_emulator(
    server: "Server", clock: "Clock | None" = None, *, protocol: str, pacing: str, camera: str,
    faults: dict[str, float], seed: int, world: dict[str, Any], **others: Any,
) -> "Emulator":  # fmt: skip
    """The emulator that the options describe; ``world`` and ``others`` as in `emulate`.

    Raises:
        ValueError: a pacing that the protocol does not have.
    """
    from dntorch.envs.emulated import emulate  # PyBullet is an extra
    from dntorch.robot.emulated.camera import CAMERAS
    from dntorch.robot.emulated.faults import Faults

    if CAMERAS[camera].blur > 0:
        require("cv2", instead="give --camera ideal")
    return emulate(
        server, clock, protocol=protocol, pacing=pacing, layout=seed, world=world,
        camera=replace(CAMERAS[camera], seed=seed),
        faults=Faults(**faults, seed=seed), **others,
    )  # fmt: skip

"""A simulated world behind a robot's protocol: what stands in for a robot."""

from importlib.util import find_spec
from typing import Any

from dntorch.envs.blocks import BlocksEnv
from dntorch.envs.epuck import EPuckEnv
from dntorch.envs.ring_env import RingEnv
from dntorch.robot.clock import Clock
from dntorch.robot.emulated.emulator import BODIES, SERIAL, Emulator
from dntorch.robot.emulated.firmware import build_firmware
from dntorch.robot.emulated.servers import Server


def emulate(
    server: Server,
    clock: Clock | None = None,
    *,
    protocol: str = "wifi",
    pacing: str = "firmware",
    layout: int = 0,
    world: dict[str, Any] | None = None,
    kind: type[BlocksEnv] | None = None,
    **worse: Any,
) -> Emulator:
    """An emulated e-puck amid its ring of blocks.

    Args:
        server: where clients come from.
        clock: real time unless you say otherwise.
        protocol: ``wifi``, ``sercom`` or ``sercom2``; the latter two over a serial line of
            115200 baud.
        pacing: of ``wifi``: ``firmware``, ``webots`` or ``request``.
        layout: seed of the order of the colours.
        world: other arguments of the env, such as ``{"ring": Ring(missing="B")}``. While it runs,
            ``world.take_away("B")`` of the emulator does the same, called from ``on_step``.
        kind: the env, by default `EPuckEnv`, or `RingEnv` where PyBullet cannot be had.
        worse: ``camera``, ``faults``, ``on_step`` of `Emulator`.

    Raises:
        ValueError: an unknown protocol or pacing, or a pacing that the protocol does not have.
    """
    firmware = build_firmware(protocol, pacing)
    if kind is None:
        kind = EPuckEnv if find_spec("pybullet") else RingEnv
    usual = {"body": BODIES[protocol], "layout_seed": layout, "senses": ()}
    ring = kind(**usual | (world or {}))  # the emulator asks for each sense when it is due
    ring.reset(seed=layout)
    bandwidth = None if protocol == "wifi" else SERIAL
    return Emulator(ring, server, firmware, clock, bandwidth=bandwidth, **worse)

"""A simulated world behind a robot's protocol: what stands in for a robot."""

from typing import Any

from dntorch.envs.blocks import BlocksEnv
from dntorch.envs.epuck import EPuckEnv
from dntorch.robot.clock import Clock
from dntorch.robot.emulator import BODIES, SERIAL, Emulator
from dntorch.robot.firmware import build_firmware
from dntorch.robot.servers import Server


def emulate(
    server: Server,
    clock: Clock | None = None,
    *,
    protocol: str = "wifi",
    pacing: str = "firmware",
    layout: int = 0,
    world: dict[str, Any] | None = None,
    kind: type[BlocksEnv] = EPuckEnv,
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
        world: other arguments of the env.
        kind: the env: `EPuckEnv`, or `RingEnv`, which needs no PyBullet.
        worse: ``camera``, ``faults``, ``on_step`` of `Emulator`.

    Raises:
        ValueError: an unknown protocol or pacing, or a pacing that the protocol does not have.
    """
    firmware = build_firmware(protocol, pacing)
    usual = {"body": BODIES[protocol], "layout_seed": layout, "senses": ()}
    ring = kind(**usual | (world or {}))  # the emulator asks for each sense when it is due
    ring.reset(seed=layout)
    bandwidth = None if protocol == "wifi" else SERIAL
    return Emulator(ring, server, firmware, clock, bandwidth=bandwidth, **worse)

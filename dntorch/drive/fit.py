"""A trained agent and a robot, made to fit each other."""

import copy
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dntorch import files
from dntorch.body import EPUCK, Body
from dntorch.envs.emulated import emulate
from dntorch.envs.hardware import HardwareEnv
from dntorch.envs.task import NOTHING
from dntorch.modules.find_color import FindColor
from dntorch.modules.sarsa import DNSarsa
from dntorch.robot.calibration import Calibration
from dntorch.robot.clock import Clock, VirtualClock
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.servers import MemoryServer
from dntorch.robot.safety import Limits
from dntorch.runs.build import senses_of
from dntorch.runs.config import Config
from dntorch.runs.run import load_trained
from dntorch.runs.train import CHECKPOINT
from dntorch.runs.worlds import WORLDS, build_task


def load_agent(run: Path) -> tuple[DNSarsa, Config]:
    """The agent that ``dntorch learn`` left in a folder, with what it learned.

    Raises:
        ValueError: no run, or one of an agent without a camera.
    """
    agent, config = load_trained(run / CHECKPOINT)
    if "image" not in WORLDS[config.world].senses:
        raise ValueError(f"{run} was trained in world={config.world!r}, without a camera: "
                         "train with --world epuck")  # fmt: skip
    return agent, config


def save_learned(path: Path, driven: DNSarsa, trained: DNSarsa, config: Config) -> None:
    """Write what an agent learned on a robot, as a checkpoint that `load_agent` reads.

    Atomically, and small: what happened in the simulation before is not in it.

    Args:
        driven: with what it knows now, made by `fit` of
        trained: whose senses are those of the simulation.
    """
    learned = {name: tensor.clone() for name, tensor in driven.state_dict().items()}
    files.save(path, {"config": asdict(config), "agent": trained.snapshot() | learned})


def fit(agent: DNSarsa, config: Config, calibration: Calibration) -> DNSarsa:
    """A copy of a trained agent, at rest, with senses and motors for one robot.

    What it learned is kept. Where images come seldom they come late, too, and it turns more
    slowly: the attraction of a heading times the time of two images stays below 0.4, and a
    scan moves things by at most 0.05 rad from one image to the next. Its patience is longer as
    the scan takes longer.
    """
    agent = copy.deepcopy(agent)
    senses = agent.sensorimotor
    agent.sensorimotor = FindColor(
        config.colors,
        axle=calibration.axle,
        hue_centers=calibration.hue_centers(config.colors),
        turning_gain=min(senses.turning_gain, 0.2 * calibration.fps),
        scan=min(senses.scan, 0.05 * calibration.fps),
        dt=config.fine,
    )
    waiting = agent.behaviors.dissatisfaction
    if waiting is not None:
        waiting.patience = waiting.patience * senses.scan / agent.sensorimotor.scan
    agent.reset()
    return agent


def hardware(
    driver: Driver,
    clock: Clock,
    config: Config,
    calibration: Calibration | None = None,
    speed: float = EPUCK.speed_cap,
    **others: Any,
) -> HardwareEnv:
    """The task of a run on a robot; ``speed`` is the cap in rad/s, ``others`` as in the env."""
    return HardwareEnv(
        driver,
        clock,
        build_task(config),
        senses=senses_of(config),
        body=Body(width=config.width, height=config.height),
        calibration=calibration,
        limits=Limits(speed=speed, watchdog=driver.dialect.watchdog),
        **others,
    )


def emulated(
    config: Config,
    layout: int,
    calibration: Calibration | None = None,
    world: dict[str, Any] | None = None,
    **emulation: Any,
) -> tuple[HardwareEnv, Emulator, list[int]]:
    """A robot over Wi-Fi that is not there, in virtual time.

    Args:
        config, calibration: as in `hardware`.
        layout: seed of the order of the blocks.
        world: arguments of ``EPuckEnv``; ``emulation``: others of `emulate`.

    Returns:
        the robot's env, the emulator, which holds its world, and colours that the world
        judges as found: they are appended as time goes on.
    """
    clock, server, seen = VirtualClock(), MemoryServer(), []
    task = {"task": build_task(config)}

    def see(info: dict[str, Any]) -> None:
        if info["found"] != NOTHING:
            seen.append(int(info["found"]))

    emulator = emulate(
        server, clock, layout=layout, world=task | (world or {}), on_step=see, **emulation
    )
    emulator.start()
    driver = Driver(server.transport(), Wifi(), clock)
    return hardware(driver, clock, config, calibration), emulator, seen

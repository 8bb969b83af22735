"""Facts that several parts need have one home: whoever needs one reads it there."""

import inspect
import subprocess
import sys

import numpy as np
import pytest
import torch

from dntorch import DNSarsa, Exploration, FindColor
from dntorch.body import EPUCK
from dntorch.colors import MIN_SATURATION, MIN_VALUE

MISSING = "numpy", "gymnasium", "pybullet", "cv2", "scipy", "matplotlib", "click"


def defaults(function) -> dict:
    """Defaults of a function's parameters, by name."""
    return {k: p.default for k, p in inspect.signature(function).parameters.items()}


def test_the_core_needs_torch_alone():
    program = (
        "import sys, torch\n"
        f"sys.modules.update(dict.fromkeys({MISSING!r}))\n"
        "import dntorch, dntorch.body\n"
        "for name in dntorch.__all__: getattr(dntorch, name)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_agent_expects_the_body_that_the_simulation_has():
    built = defaults(FindColor.__init__)
    assert built["fov"] is EPUCK.fov and built["max_speed"] is EPUCK.speed_cap
    assert built["wheel_radius"] is EPUCK.wheel_radius and built["axle"] is EPUCK.axle


@pytest.mark.parametrize("value", range(0, 256, 5))
def test_a_robot_is_calibrated_with_the_colours_that_its_agent_sees(value):
    from dntorch.robot.calibration import measure_hues

    grays = np.linspace(0, value, 26).round()
    image = np.stack((np.full(26, value), grays, grays), -1).astype(np.uint8)
    for column in image:
        pixel = column[None, None]
        seen = FindColor("RG").percept(torch.from_numpy(pixel)).max() > 0
        try:
            measured = bool(measure_hues([pixel], "R"))
        except ValueError:
            measured = False
        assert measured == bool(seen)


def test_what_is_a_colour_is_said_once():
    built = defaults(FindColor.__init__)
    assert built["min_saturation"] is MIN_SATURATION and built["min_value"] is MIN_VALUE


def test_the_agent_of_a_run_is_the_agent_that_a_user_builds():
    from dntorch.runs.build import build_agent, build_exploration
    from dntorch.runs.config import Config

    config = Config()
    run, own = build_agent(config), DNSarsa(4, FindColor("RGBY"))
    for (name, part), (other_name, other) in zip(run.named_modules(), own.named_modules()):
        assert name == other_name and numbers(part) == numbers(other)
    noise, usual = build_exploration(config), Exploration(4, seed=0)
    assert numbers(noise) == numbers(usual) and noise.amplitude == config.noise


def numbers(part) -> dict:
    """Parameters that are plain numbers."""
    return {k: v for k, v in vars(part).items() if isinstance(v, int | float)}


def test_all_worlds_pay_alike():
    pytest.importorskip("gymnasium")
    pytest.importorskip("pybullet")
    from dntorch.envs import EPuckEnv, HardwareEnv, RingEnv
    from dntorch.envs.task import SequenceTask
    from dntorch.runs.config import Config

    task, config = SequenceTask(), Config()
    for name in ("sequence", "colors", "reward", "dt"):
        assert getattr(config, name) == getattr(task, name)
    assert round(config.reward_duration / config.dt) == task.steps
    assert repr(HardwareEnv(None).task) == repr(task)
    for env in (EPuckEnv(), RingEnv()):
        assert repr(env.task) == repr(task)
        env.close()

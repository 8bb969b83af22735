"""A trained agent on a robot: what it reports, how it is made to fit, what is said of a drive."""

import numpy as np
import pytest
import torch

pytest.importorskip("gymnasium")

from dntorch.drive.driving import Onset, Step, Trip, why_not
from dntorch.drive.fit import fit, hardware, load_agent, save_learned
from dntorch.envs.task import NOTHING
from dntorch.robot.calibration import Calibration
from dntorch.robot.clock import VirtualClock
from dntorch.robot.dialects import Sercom, Sercom2, Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.servers import MemoryServer
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config


def test_what_came_on_is_reported_not_what_is_strongest():
    report, none = Onset(3), NOTHING
    steps = [(0, 0, 0), (0.6, 0, 0), (0.9, 0, 0), (1, 0.51, 0), (0.4, 0.9, 0), (0, 0.5, 0)]
    assert [report(np.array(rates)) for rates in steps] == [none, 0, none, 1, none, none]


def test_an_agent_made_to_fit_keeps_its_values_and_turns_as_its_images_allow():
    config = Config()
    agent = build_agent(config)
    agent.weights.copy_(torch.arange(16.0).view(4, 4))
    hues = {"R": 4.0, "G": 118.0, "B": 235.0, "Y": 52.0}
    fitted = fit(agent, config, Calibration(hues=hues, axle=0.056, fps=5.0))
    assert torch.equal(fitted.weights, agent.weights) and fitted.weights is not agent.weights
    senses, before = fitted.sensorimotor, agent.sensorimotor
    assert senses.axle == 0.056 and not torch.equal(senses.hue_bias, before.hue_bias)
    assert (senses.turning_gain, senses.scan) == (1.0, 0.25)
    agent.sensorimotor.scan = 0.2
    fast = fit(agent, config, Calibration()).sensorimotor
    assert (fast.turning_gain, fast.scan) == (before.turning_gain, before.scan)
    assert torch.equal(fast.hue_bias, before.hue_bias)


def test_what_is_learned_is_saved_with_the_senses_of_the_simulation(tmp_path):
    config = Config()
    trained = build_agent(config)
    driven = fit(trained, config, Calibration(fps=5.0, hues=dict(zip("RGBY", (9, 110, 230, 50)))))
    driven.weights.fill_(0.25)
    save_learned(tmp_path / "checkpoint.pt", driven, trained, config)
    again, same = load_agent(tmp_path)
    assert same == config and torch.equal(again.weights, driven.weights)
    assert torch.equal(again.sensorimotor.hue_bias, trained.sensorimotor.hue_bias)
    assert (trained.weights == 0).all()


@pytest.mark.parametrize("dialect, watchdog", [(Wifi, 0.5), (Sercom, 0.8), (Sercom2, 0.8)])
def test_the_watchdog_waits_for_a_serial_line(dialect, watchdog):
    driver = Driver(MemoryServer().transport(), dialect(), VirtualClock())
    env = hardware(driver, driver.clock, Config(width=64, height=48), speed=0.7)
    assert (env.guard.limits.watchdog, env.guard.limits.speed) == (watchdog, 0.7)
    assert env.observation_space["image"].shape == (48, 64, 3)


def trip_of(letters: str, seconds_each: float = 1.0) -> Trip:
    """A trip of finding these colours, each sequence noticed as the task does."""
    trip, found = Trip(Config(), scan=0.3), ""
    for letter in letters:
        found += letter
        for k in range(round(32 * seconds_each)):
            color = trip.config.colors.index(letter) if k == 0 else NOTHING
            info = {
                "completed": k == 0 and found.endswith("GBYRG"), "stopped": "", "fresh": True,
                "age": 0.1, "late": 0.0, "speeds": np.ones(2), "connections": 1,
            }  # fmt: skip
            trip.write(Step(np.zeros(1), 0.0, color, info))
    trip.over(10**6, 2)
    return trip


@pytest.mark.parametrize("found, seen, said", [
    ("YRGBYRGBYRG", "YRGBYRGBYRG", ""),
    ("YRGBYRGBYRG", "YRGBYRGBYR", ""),  # the world has not yet noticed the last
    ("GBYRGYRGBYRG", "GBYRGYRGBYRG", "a detour: GBYRGYRGBYRG"),
    ("GBYRGBYRG", "GBYRGRYRG", "reported GBYRGBYRG, the world saw GBYRGRYRG"),
    ("GBYRGBYRG", "GBYRGBY", "reported GBYRGBYRG, the world saw GBYRGBY"),
])  # fmt: skip
def test_why_a_robot_did_not_succeed(found, seen, said):
    assert why_not(trip_of(found), seen) == said


def test_finding_nothing_for_more_than_a_turn_ends_it():
    assert trip_of("GB", 30.0).ending == ""
    stuck = trip_of("GB", 41.0)
    assert stuck.ending == "nothing was found for 40 s"
    assert why_not(stuck, "GB") == "nothing was found for 40 s after GB"
    slow = Trip(Config(), scan=0.12)
    assert 70 < slow.patience < 90

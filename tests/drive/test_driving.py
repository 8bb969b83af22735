"""A trained agent on a robot: what it reports, how it is made to fit, what is said of a drive."""

import numpy as np
import pytest
import torch

pytest.importorskip("gymnasium")

from dntorch.drive.driving import Onset, Step, Trip, acting, perform, spoken, why_not
from dntorch.drive.fit import emulated, fit, hardware, load_agent, save_learned
from dntorch.envs.ring_env import RingEnv
from dntorch.envs.task import NOTHING
from dntorch.robot.calibration import Calibration
from dntorch.robot.clock import VirtualClock
from dntorch.robot.dialects import Sercom, Sercom2, Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.servers import MemoryServer
from dntorch.runs.build import build_agent, build_lifelong
from dntorch.runs.config import AUTONOMOUS, Config


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


def beyond(**others) -> Config:
    """A run without phases, with all parts that an agent may have."""
    parts = {"recall": 1, "constraints": 20.0, "curiosity": 4.0, "steps": 100, "explore": 100}
    return Config(**AUTONOMOUS | parts | others)


def test_all_that_is_learned_on_a_robot_is_saved(tmp_path):
    config = beyond()
    trained = build_agent(config)
    driven = fit(trained, config, Calibration())
    for value in driven.state_dict().values():  # the long-term memory itself
        value.fill_(0.25)
    save_learned(tmp_path / "checkpoint.pt", driven, trained, config)
    again = load_agent(tmp_path)[0].state_dict()
    assert {*again} == {
        "learner.values.weights", "deliberation.constraints.suppression",
        "deliberation.curiosity.weights",
    }  # fmt: skip
    assert all((value == 0.25).all() for value in again.values())


def test_an_agent_that_turns_more_slowly_waits_longer():
    agent = build_agent(beyond())
    for fps, waits in ((8.0, 20.0), (3.0, 40.0)):
        fitted = fit(agent, beyond(), Calibration(fps=fps))
        assert float(fitted.behaviors.dissatisfaction.patience) == pytest.approx(waits)
        assert Trip.of(fitted, beyond()).patience > 4 * waits
    assert float(agent.behaviors.dissatisfaction.patience) == 20.0
    plain = build_agent(Config())
    assert Trip.of(plain, Config()).patience == Trip(Config(), plain.sensorimotor.scan).patience


def test_only_an_agent_without_phases_acts_with_noise():
    assert build_lifelong(beyond()).amplitude == AUTONOMOUS["noise"]
    assert build_lifelong(beyond(explore=99)) is None
    assert build_lifelong(Config(steps=100, explore=100)) is None  # it was to exploit later


def test_a_robot_shows_an_agent_its_lamp():
    """It is that of what the agent has reported."""
    config = beyond(world="ring", sequence="GB")
    env, _, _ = emulated(config, 0, Calibration(fov=0.656, fps=8.0), kind=RingEnv)
    agent, seen = fit(build_agent(config), config, env.calibration), []
    trip = Trip.of(agent, config)
    drives = acting(agent, build_lifelong(config))

    def act(observation, reward):
        wheels, _ = drives(observation, reward)
        return wheels, config.colors.index("G") if len(seen) == 8 else NOTHING

    perform(env, act, trip, 12, each=lambda step: seen.append(float(step.observation["lamp"][0])))
    assert seen == [0.0] * 8 + [0.5] * 4


def lose_blue(constraints: float) -> tuple[str, str, int, int]:
    """What a robot finds that knows G-B-R-G, before and after blue is taken away while it looks
    for it; how often it fails then, and with how many intentions of blue."""
    config = Config(
        world="ring", sequence="GBRG", steps=1000, explore=1000,
        **AUTONOMOUS | {"constraints": constraints, "patience": 8.0},
    )  # fmt: skip
    agent, known = build_agent(config), Calibration(fov=0.656, fps=8.0)
    for now, then in ("GB", "BR", "RG", "YG"):
        agent.weights[config.colors.index(then), config.colors.index(now)] = 0.5
    env, emulator, _ = emulated(config, 0, known, kind=RingEnv)
    agent = fit(agent, config, known)
    trip, wants = Trip.of(agent, config), [""]
    lost = []

    def take(step):
        now = spoken(agent, config)
        if now != wants[-1]:
            wants.append(now)
        if now == "find blue" and trip.letters and not lost:
            lost.append((len(trip.letters), len(wants) - 1))
            emulator.world.take_away("B")

    perform(env, acting(agent, build_lifelong(config)), trip, 1100, iterations=100, each=take)
    (found, begun), letters = lost[0], trip.letters
    return letters[:found], letters[found:], int(agent.failures), wants[begun:].count("find blue")


def test_a_block_is_taken_away_and_the_robot_goes_on_if_it_learns_from_failures():
    before, after, failures, blue = lose_blue(constraints=20.0)
    assert before.endswith("G") and len(after) >= 2 and "B" not in after
    assert failures >= 1 and blue == 1
    # Learned values outweigh the small noise: patience alone wants the same again.
    before, after, failures, blue = lose_blue(constraints=0.0)
    assert before.endswith("G") and after == "" and failures >= 2 and blue >= 3


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

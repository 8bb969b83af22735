"""A colour of which no block stands in the ring, from the beginning or taken away."""

from importlib.util import find_spec

import numpy as np
import pytest
import torch

gymnasium = pytest.importorskip("gymnasium")

from needs import EPUCK  # noqa: E402
from robot_worlds import Setup  # noqa: E402

from dntorch.cells.color import hue_saturation_value  # noqa: E402
from dntorch.colors import HUES, MIN_SATURATION, MIN_VALUE  # noqa: E402
from dntorch.envs import Ring, RingEnv, RingWorld, SequenceTask  # noqa: E402
from dntorch.envs.adaptor import GymWorld  # noqa: E402
from dntorch.envs.emulated import emulate  # noqa: E402
from dntorch.robot.clock import VirtualClock  # noqa: E402
from dntorch.robot.emulated.camera import Camera  # noqa: E402
from dntorch.robot.emulated.emulator import WIFI_BODY  # noqa: E402
from dntorch.robot.emulated.servers import MemoryServer  # noqa: E402

NO_BLUE = Ring(missing="B")
RED, GREEN, BLUE, YELLOW = range(4)


def build(name, *arguments, **others):
    if name == "epuck":
        from dntorch.envs import EPuckEnv

        return EPuckEnv(*arguments, **others)
    return RingEnv(*arguments, **others)


def pixels(image):
    """How many pixels have the hue of each letter, within 10 degrees."""
    hue, saturation, value = hue_saturation_value(torch.tensor(np.array(image)))
    colored = (saturation >= MIN_SATURATION) & (value >= MIN_VALUE)
    off = {letter: ((hue - HUES[letter] + 180) % 360 - 180).abs() for letter in "RGBY"}
    return {letter: int((colored & (off[letter] < 10)).sum()) for letter in "RGBY"}


def around(env, steps=100):
    """Pixels of each hue in a whole turn."""
    images = [env.step(env.body.spin(2 * np.pi * 32 / steps))[0]["image"] for _ in range(steps)]
    return pixels(images)


def wide(name, **others):
    """An env whose motors turn it as fast as `around` asks for."""
    return build(name, body=WIFI_BODY, senses=("image",), **others)


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_no_image_has_its_hue_and_each_place_a_block(name):
    others = {} if name == "ring" else {"pivot": "kinematic"}
    all_there, world = wide(name, **others), wide(name, ring=NO_BLUE, **others)
    for env in (all_there, world):
        env.reset(seed=5)
    before, after = around(all_there), around(world)
    assert before["B"] > 1000 and after["B"] == 0
    assert all(after[letter] > before[letter] for letter in "RGY")
    assert sum(after.values()) == pytest.approx(sum(before.values()), rel=0.02)
    for env in (all_there, world):
        env.close()


def test_only_the_places_of_the_missing_are_others_the_rest_in_turn():
    full, missing = RingWorld(), RingWorld(ring=NO_BLUE)
    for seed in range(5):
        drawn, left = (each.initial(seed=seed).layout for each in (full, missing))
        was_blue = drawn == BLUE
        assert was_blue.sum() == 4 and torch.equal(drawn[~was_blue], left[~was_blue])
        assert left[was_blue].tolist() == [RED, GREEN, YELLOW, RED]
    two = RingWorld(ring=Ring(missing="RY")).initial(seed=0).layout
    assert torch.bincount(two).tolist() == [0, 8, 8]


def test_layouts_are_the_same_in_every_world():
    batch = RingWorld(ring=NO_BLUE).initial([3], seed=7, agents=torch.arange(3)).layout
    assert not (batch == BLUE).any() and batch[1].tolist() != batch[2].tolist()
    envs = [build("ring", ring=NO_BLUE), build("ring", ring=Ring(missing="B"), layout_seed=7)]
    if find_spec("pybullet"):
        envs.append(build("epuck", ring=NO_BLUE))
    for env in envs:
        env.reset(seed=7)
        assert env.layout.tolist() == batch[0].tolist()
        env.close()


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_taken_away_it_is_gone_from_images_and_judge_until_the_reset(name):
    others = {} if name == "ring" else {"pivot": "kinematic"}
    env = wide(name, render_mode="rgb_array", **others)
    env.reset(seed=5)
    block = int(np.flatnonzero(env.layout == BLUE)[0])
    for _ in range(100):  # before the first blue block, not yet long enough
        *_, info = env.step(env.body.spin(np.clip(4 * env.bearings[block], -2, 2)))
        if info["centered"] == BLUE:
            break
    env.take_away("B")
    stands_for = env.layout[block]
    infos = [env.step(np.zeros(2))[4] for _ in range(20)]
    assert [info["found"] for info in infos if info["found"] >= 0] == [stands_for] != [BLUE]
    assert pixels(env.render())["B"] == around(env)["B"] == 0
    from_the_first = wide("ring", ring=NO_BLUE)
    from_the_first.reset(seed=5)
    assert env.layout.tolist() == from_the_first.layout.tolist()
    env.take_away("G")
    assert set(env.layout) == {RED, YELLOW}
    env.reset(seed=5)
    assert around(env)["B"] > 1000
    env.close()


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_a_snapshot_keeps_it_away(name):
    first, second = build(name), build(name)
    first.reset(seed=5), second.reset(seed=6)
    first.take_away("B")
    second.load_state_dict(first.state_dict())
    for _ in range(5):
        (seen, *rest), (other, *expected) = (e.step(np.array([1.0, -1.0])) for e in (second, first))
        assert np.array_equal(seen["image"], other["image"]) and rest == expected
    assert BLUE not in second.layout
    with pytest.raises(ValueError, match=r"another world: build .*missing='B'"):
        first.reset(seed=5)
        missing = build(name, ring=NO_BLUE)
        missing.reset(seed=5)
        first.load_state_dict(missing.state_dict())
    for env in (first, second, missing):
        env.close()


def test_as_a_world_it_resumes_without_it():
    world = GymWorld(RingEnv(ring=NO_BLUE))
    state = world.initial(seed=5)
    _, state = world.step(torch.tensor([1.0, -1.0]), state)
    saved = world.snapshot(state)
    expected, _ = world.step(torch.tensor([1.0, -1.0]), state)
    other = GymWorld(RingEnv(ring=Ring(missing="B")))
    restored = other.restore(saved, other.initial(seed=0))
    outcome, _ = other.step(torch.tensor([1.0, -1.0]), restored)
    assert torch.equal(outcome.observation["image"], expected.observation["image"])


@pytest.mark.parametrize("missing", ["RGB", "RGBY", "V", "BV"])
@pytest.mark.parametrize("kind", [RingEnv, RingWorld])
def test_two_colors_must_be_left_and_all_be_known(kind, missing):
    with pytest.raises(
        ValueError, match=rf"missing='{missing}': give different letters of colors='RGBY'"
    ):
        kind(ring=Ring(missing=missing))


@pytest.mark.parametrize("missing", ["V", "RGB", None, 2, ["B"]])
def test_what_cannot_be_taken_away_is_refused_and_stays(missing):
    env = RingEnv(SequenceTask("GB"), senses=())
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.take_away("B")
    env.reset(seed=5)
    before = env.layout.tolist()
    with pytest.raises(
        ValueError, match=r"missing=.*: give different letters of colors='RGBY' that leave"
    ):
        env.take_away(missing)
    assert env.layout.tolist() == before
    env.take_away("B")
    with pytest.raises(
        ValueError, match="missing='B': give different letters of colors='RGY' that leave"
    ):
        env.take_away("B")


# ---------------------------------------------------------------- behind a robot's protocol


def turn(setup, seconds):
    """Blue pixels in the frames of a robot that turns."""
    images, last = [], -1
    for _ in range(round(seconds * 10)):
        setup.driver.drive(-1.0, 1.0)
        setup.wait(0.1)
        frame = setup.driver.frame
        if frame is not None and frame.number != last:
            images.append(frame.image)
            last = frame.number
    assert len(images) > 50
    return pixels(images)["B"]


def world_of(**others):
    env = RingEnv(body=WIFI_BODY, senses=(), **others)
    env.reset(seed=5)
    return env


def test_an_emulated_robot_sees_none_and_loses_it_while_it_runs():
    for ring, sees in ((Ring(), True), (NO_BLUE, False)):
        setup = Setup(pacing="request", world=world_of(ring=ring), camera=Camera())
        setup.driver.connect()
        assert (turn(setup, 9) > 1000) is sees
    setup, seen = Setup(pacing="request", world=world_of()), []

    def lose(info):
        seen.append(int(info["centered"]))
        if setup.emulator.steps == 9 * 32:
            setup.world.take_away("B")

    setup.emulator.on_step = lose
    setup.driver.connect()
    assert turn(setup, 8.9) > 1000 and BLUE in seen
    setup.wait(0.5)
    seen.clear()
    assert turn(setup, 9) == 0
    assert BLUE not in seen and set(seen) >= {RED, GREEN, YELLOW}


def test_an_emulator_is_built_with_it():
    emulator = emulate(MemoryServer(), VirtualClock(), world={"ring": NO_BLUE}, kind=RingEnv)
    assert set(emulator.world.layout) == {RED, GREEN, YELLOW}

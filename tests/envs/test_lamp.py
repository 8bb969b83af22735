"""The lamp amid blocks and on a robot: shown where it is asked for, and what it shows."""

import warnings

import numpy as np
import pytest
import torch

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from needs import EPUCK  # noqa: E402
from robot_worlds import Setup  # noqa: E402

from dntorch.envs import HardwareEnv, RingEnv, RingWorld, SequenceTask  # noqa: E402
from dntorch.envs.adaptor import GymWorld  # noqa: E402

TASK = SequenceTask("GBG", duration=0.25)
LAMP = ("wheels", "lamp")


def build(name, **arguments):
    if name == "epuck":
        from dntorch.envs import EPuckEnv

        return EPuckEnv(**arguments)
    return RingEnv(**arguments)


def turn_to(env, color):
    """Turn to the nearest block of a colour until it is found: the last step."""
    for _ in range(600):
        same = env.bearings[env.layout == env.colors.index(color)]
        bearing = same[np.abs(same).argmin()]
        outcome = env.step(env.body.spin(np.clip(2 * bearing, -0.9, 0.9)))
        if outcome[4]["found"] >= 0:
            return outcome
    raise AssertionError(f"{color} was not found")


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_it_shows_the_progress_after_the_step(name):
    env = build(name, task=TASK, senses=LAMP)
    assert env.observation_space["lamp"] == gymnasium.spaces.Box(0, 1, (1,), np.float32)
    seen, _ = env.reset(seed=3)
    assert list(seen["lamp"]) == [0] and seen in env.observation_space
    for color, share in zip("GBYGBG", (1, 2, 0, 1, 2, 3)):
        seen, *_ = turn_to(env, color)
        assert seen["lamp"].dtype == np.float32 and seen in env.observation_space
        assert list(seen["lamp"]) == [np.float32(share / 3)]
    seen, *_ = env.step(np.zeros(2))
    assert list(seen["lamp"]) == [1]
    env.reset()
    assert list(env.sense("lamp")) == [0]
    env.close()


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_a_snapshot_holds_it_and_the_age_of_the_task(name):
    task = SequenceTask("GBG", then=("BYR", 10_000))
    first, second = (build(name, task=task, senses=LAMP) for _ in range(2))
    first.reset(seed=3), second.reset(seed=4)
    for color in "GB":
        turn_to(first, color)
    state = first.state_dict()
    age = int(state["task"][2])
    assert age == state["steps"] > 16
    second.load_state_dict(state)
    assert list(second.sense("lamp")) == list(first.sense("lamp")) == [np.float32(2 / 3)]
    # The same moment in a world that changes now: B is the first of B-Y-R.
    third = build(name, task=SequenceTask("GBG", then=("BYR", age)), senses=LAMP)
    third.reset(seed=3)
    for color in "GB":
        seen, *_ = turn_to(third, color)
    assert list(seen["lamp"]) == [np.float32(1 / 3)]
    for env in (first, second, third):
        env.close()


@pytest.mark.parametrize("name", ["ring", EPUCK])
def test_gymnasium_checker_is_content(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")
        kind = {"ring": "Ring", "epuck": "EPuck"}[name]
        env = gymnasium.make(
            f"dntorch:dntorch/{kind}-v0", senses=("image", "lamp"), render_mode="rgb_array"
        )
        check_env(env.unwrapped)
        env.close()


def test_what_is_not_asked_for_is_not_computed(monkeypatch):
    monkeypatch.setattr(SequenceTask, "progress", None)
    env, world = RingEnv(), RingWorld(senses=("wheels", "proximity"))
    assert "lamp" not in env.reset(seed=0)[0] and "lamp" not in env.step(np.zeros(2))[0]
    outcome, _ = world.step(torch.zeros(2), world.initial())
    assert list(outcome.observation) == ["wheels", "proximity"]
    with pytest.raises(TypeError):
        env.sense("lamp")


def test_an_env_as_a_world_and_the_world_in_batches_show_the_same():
    gym, world = GymWorld(RingEnv(TASK, senses=LAMP)), RingWorld(TASK, senses=LAMP)
    assert set(gym.senses) == set(world.senses) == set(LAMP)
    one, both = gym.initial(seed=3), world.initial((2,), seed=3)
    env, shown = gym.env, set()
    assert world.observe(both)["lamp"].tolist() == [[0.0], [0.0]]
    for color in "GBGG":
        for _ in range(150):
            same = env.bearings[env.layout == env.colors.index(color)]
            turning = np.clip(2 * same[np.abs(same).argmin()], -0.9, 0.9)
            action = torch.tensor(env.body.spin(turning), dtype=torch.float32)
            outcome, one = gym.step(action, one)
            # The second robot stands still and finds nothing.
            batch, both = world.step(torch.stack([action, 0 * action]), both)
            lamp = outcome.observation["lamp"]
            assert lamp.shape == (1,) and lamp.dtype == torch.float32
            assert batch.observation["lamp"].shape == (2, 1)
            assert torch.equal(batch.observation["lamp"][0], lamp)
            assert float(batch.observation["lamp"][1]) == 0
            shown.add(round(3 * float(lamp)))
    assert shown == {0, 1, 2, 3}


def test_a_robot_shows_what_was_reported():
    setup = Setup(pacing="request")
    env = HardwareEnv(setup.driver, setup.clock, TASK, senses=("wheels", "lamp"))
    seen, _ = env.reset()
    assert list(seen["lamp"]) == [0] and seen in env.observation_space
    for color, share in zip("GBGY", (1, 2, 3, 0)):
        env.report(env.colors.index(color))
        for _ in range(2):
            seen, *_ = env.step(np.zeros(2))
            assert list(seen["lamp"]) == [np.float32(share / 3)] and seen in env.observation_space
    env.report(env.colors.index("G"))
    env.step(np.zeros(2))
    assert list(env.reset()[0]["lamp"]) == [0]
    env.close()


def test_torchrl_env_has_it():
    pytest.importorskip("torchrl")
    from torchrl.envs import check_env_specs

    from dntorch.envs import NodesWorld
    from dntorch.rl import WorldEnv

    for world in (NodesWorld(senses=("match", "lamp")), RingWorld(senses=LAMP)):
        env = WorldEnv(world, [3])
        check_env_specs(env)
        assert env.rollout(2)["lamp"].shape == (3, 2, 1)

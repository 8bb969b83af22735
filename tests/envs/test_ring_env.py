"""The ring env: what the PyBullet env promises, kept without PyBullet, and the two side by side."""

import math
import pickle
import subprocess
import sys
import warnings
from importlib.util import find_spec

import numpy as np
import pytest
import torch

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from dntorch.body import Body  # noqa: E402
from dntorch.envs import Light, Ring, RingEnv, RingWorld, SequenceTask  # noqa: E402
from dntorch.envs.adaptor import GymWorld  # noqa: E402


def wander(env, steps, seed=0):
    """Drive at random; every byte of what came back."""
    random, record = np.random.default_rng(seed), []
    for _ in range(steps):
        observation, reward, *_, info = env.step(random.uniform(-1.26, 1.26, 2))
        record += [observation[key].tobytes() for key in sorted(observation)]
        record += [reward, *(value.tobytes() for value in info.values())]
        record += [part.tobytes() for part in env.pose]
    return record


def turn_to(env, color, gain=2.0, limit=600):
    """Turn to the nearest block of a colour by true bearing until the world counts it."""
    for _ in range(limit):
        same = env.bearings[env.layout == env.colors.index(color)]
        bearing = same[np.abs(same).argmin()]
        *step, info = env.step(env.body.spin(np.clip(gain * bearing, -0.9, 0.9)))
        if info["found"] >= 0:
            return env.colors[info["found"]], step[1], info
    raise AssertionError(f"{color} was not found in {limit} steps")


def hold(env, steps, yaw_rate=0.0):
    outcomes = [env.step(env.body.spin(yaw_rate)) for _ in range(steps)]
    return [outcome[4] for outcome in outcomes], [outcome[1] for outcome in outcomes]


def test_gymnasium_checker_is_content():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Wheel speeds are in rad/s; gymnasium.wrappers.RescaleAction serves who wants [-1, 1].
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")
        env = gymnasium.make("dntorch:dntorch/Ring-v0", render_mode="rgb_array")
        check_env(env.unwrapped)
        env.close()


@pytest.mark.parametrize(("dt", "fps"), [(1 / 8, 8), (1 / 32, 32), (0.1, 10), (0.15, 20 / 3)])
def test_pictures_per_second_are_steps_per_second(dt, fps):
    import gymnasium

    envs = [
        gymnasium.make(
            f"dntorch:dntorch/{name}-v0", task=SequenceTask(dt=dt), render_mode="rgb_array"
        )
        for name in ("Ring", "EPuck")[: 1 + bool(find_spec("pybullet"))]
    ]
    for env in envs:
        assert env.metadata["render_fps"] == pytest.approx(fps)
        assert env.unwrapped.metadata["render_modes"] == ["rgb_array"]
        env.close()


def test_it_needs_neither_pybullet_nor_opencv():
    code = """
import sys
sys.modules["pybullet"] = sys.modules["cv2"] = None
from dntorch.envs import RingEnv
from dntorch.envs.emulated import emulate
from dntorch.robot.clock import VirtualClock
from dntorch.robot.emulated.servers import MemoryServer
env = RingEnv(render_mode="rgb_array")
env.reset(seed=0); env.step([0.1, 0.2]); assert env.render().shape == (360, 480, 3)
env.close(); env.close()
emulator = emulate(MemoryServer(), VirtualClock(), kind=RingEnv)
assert emulator.world.sense("image").shape == (120, 160, 3)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == b"" and done.stderr == b""


def test_same_seed_same_bytes_and_snapshots_resume_exactly():
    first, second = RingEnv(), RingEnv(render_mode="rgb_array")
    first.reset(seed=5)
    wander(first, 30)
    state = pickle.loads(pickle.dumps(first.state_dict()))
    expected = wander(first, 30, seed=2)
    second.load_state_dict(state)
    second.render()
    assert wander(second, 30, seed=2) == expected
    first.reset(), second.reset()
    assert first.layout.tolist() == second.layout.tolist()
    with pytest.raises(ValueError, match=r"another world: build RingEnv\("):
        RingEnv(SequenceTask(reward=3.0)).load_state_dict(state)


@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_step_by_step_as_pybullet_with_its_robot_on_a_pin(shape):
    pytest.importorskip("pybullet")
    from dntorch.envs import EPuckEnv

    others = {"ring": Ring(block_shape=shape), "light": Light(ambient=0.4)}
    ours, theirs = RingEnv(**others), EPuckEnv(pivot="kinematic", **others)
    random = np.random.default_rng(0)
    seen, other = ours.reset(seed=3)[0], theirs.reset(seed=3)[0]
    for _ in range(40):
        wrong = abs(seen["image"].astype(int) - other["image"]).max(-1) > 2
        assert wrong.mean() < 0.01
        assert np.array_equal(seen["wheels"], other["wheels"])
        np.testing.assert_allclose(seen["proximity"], other["proximity"], rtol=1e-4)
        action = random.uniform(-1.5, 1.5, 2)
        (seen, *rest), (other, *expected) = ours.step(action), theirs.step(action)
        assert rest == expected
    theirs.close()


def test_step_by_step_as_the_world_in_batches():
    env = RingEnv()
    world = RingWorld(senses=("image", "wheels", "proximity"))
    state, random, found = world.initial(seed=4), np.random.default_rng(0), []
    seen, _ = env.reset(seed=4)
    for step in range(300):
        wrong = world.observe(state)["image"].numpy() != seen["image"]
        assert wrong.mean() < 0.01
        nearest = env.bearings[abs(env.bearings).argmin()]
        turning = 0.9 if step % 75 < 20 else 2 * nearest + random.normal(0, 0.01)
        action = np.array(env.body.spin(np.clip(turning, -0.9, 0.9)), np.float32)
        outcome, state = world.step(torch.from_numpy(action), state)
        seen, reward, *_, info = env.step(action)
        assert np.array_equal(outcome.observation["wheels"], seen["wheels"])
        assert (int(outcome.found), float(outcome.reward)) == (info["found"], reward)
        assert float(world.yaw(state)) == pytest.approx(info["yaw"], abs=1e-6)
        found += [int(outcome.found)] if outcome.found >= 0 else []
    assert len(found) >= 3


def test_sequence_is_rewarded_exactly_at_completion_for_its_duration():
    env = RingEnv()
    env.reset(seed=3)
    for color in "GBYR":
        assert turn_to(env, color)[0] == color
        infos, rewards = hold(env, 40)
        assert all(info["found"] == -1 for info in infos) and not any(rewards)
    color, reward, info = turn_to(env, "G")
    assert (color, reward, bool(info["completed"])) == ("G", 2.0, True)
    assert hold(env, 40)[1] == [2.0] * 31 + [0.0] * 9


@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_block_appears_in_the_column_of_its_bearing(shape):
    env = RingEnv(ring=Ring(block_shape=shape, block_size=0.06))
    env.reset(seed=0)
    for _ in range(40):
        observation, *_, info = env.step(env.body.spin(0.3))
        column = (env.body.width - 1) / 2 - env.body.focal * math.tan(info["bearing"])
        colored = np.ptp(observation["image"].astype(int), axis=2).max(axis=0) > 60
        around = np.flatnonzero(colored & (abs(np.arange(52) - column) < 7))
        assert abs(around.mean() - column) < 1.5


def test_view_from_above_shows_every_block_and_where_the_robot_looks():
    env = RingEnv(render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture.dtype == np.uint8 and picture.shape == (360, 480, 3)
    pixel = 2.2 * (0.40 + 0.08) / 360
    for (x, y), color in zip(env.ring.centers, env.layout, strict=True):
        place = round(179.5 - x / pixel), round(239.5 - y / pixel)
        paint = {"R": (255, 0, 0), "G": (0, 255, 0), "B": (0, 0, 255), "Y": (255, 255, 0)}
        assert tuple(picture[place]) == paint[env.colors[color]]
    assert picture[100, 240].mean() > picture[260, 240].mean() + 20, "sight is up"
    hold(env, 20, 0.9)
    assert not np.array_equal(env.render(), picture)
    assert np.array_equal(env.view(env.pose), env.render())
    assert RingEnv().render() is None


def test_senses_cameras_and_ends():
    env = RingEnv(body=Body(width=7, height=5, fov=1.5), senses=("image",), max_seconds=0.25)
    observation, _ = env.reset(seed=0)
    assert list(observation) == ["image"] and observation in env.observation_space
    assert env.sense("proximity").dtype == np.float32
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(8)]
    assert ends == [(False, False)] * 7 + [(False, True)]
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step([0, 0])
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="build a new one"):
        env.reset()


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"task": "GBYRG"}, "task='GBYRG'"),
        ({"ring": Ring(block_shape="mixed")}, "block_shape='mixed'"),
        ({"light": Light(shadow=True)}, "shadow=True"),
        ({"layout_seed": -1}, "layout_seed=-1"),
        ({"render_mode": "human"}, "render_mode='human'"),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, name):
    with pytest.raises(ValueError) as error:
        RingEnv(**arguments)
    assert name in str(error.value) and "give" in str(error.value)


def test_torchrl_env_of_a_batch():
    pytest.importorskip("torchrl")
    from torchrl.envs import check_env_specs

    from dntorch.rl import WorldEnv

    world = RingWorld(senses=("image", "wheels", "proximity"))
    env = WorldEnv(world, [3], seed=torch.arange(3))
    check_env_specs(env)
    rollout = env.rollout(5)
    assert rollout["image"].shape == (3, 5, 39, 52, 3)
    state = world.initial([3], seed=torch.arange(3))
    for k in range(5):
        outcome, state = world.step(rollout["action"][:, k], state)
        assert torch.equal(rollout["next", "image"][:, k], outcome.observation["image"])
    saved = env.state_dict()
    expected = env.rollout(3, auto_reset=False, tensordict=rollout[:, -1])
    env.load_state_dict(saved)
    wheels = env.state.wheels.clone()
    mask = torch.tensor([[True], [False], [False]])
    env.reset(rollout[:, -1].clone().set("_reset", mask))
    assert not env.state.wheels[0].any() and torch.equal(env.state.wheels[1:], wheels[1:])
    assert expected.shape == (3, 3)


@pytest.mark.parametrize(
    "damage",
    [
        lambda s: s.pop("drive"),
        lambda s: s.update(drive="x"),
        lambda s: s.update(layout=s["layout"][:3]),
        lambda s: s.update(steps="x"),
        lambda s: s.update(task=()),
        lambda s: s.update(random={}),
    ],
)
def test_a_damaged_snapshot_leaves_the_env_as_it_was(damage):
    env, world = (RingEnv(senses=("wheels",)) for _ in range(2))
    for each in (env, world):
        each.reset(seed=3)
        each.step(np.array([0.5, -0.5]))
    snapshot = env.state_dict()
    env.step(np.array([1.0, 0.0])), world.step(np.array([1.0, 0.0]))
    damage(snapshot)
    with pytest.raises(ValueError, match=r"the snapshot is damaged .*: give another"):
        env.load_state_dict(snapshot)
    for _ in range(3):
        left, right = (each.step(np.array([0.3, 0.1])) for each in (env, world))
        np.testing.assert_array_equal(left[0]["wheels"], right[0]["wheels"])
        assert left[1:] == right[1:]
    with pytest.raises(ValueError, match="is no snapshot: give"):
        env.load_state_dict({})


@pytest.mark.parametrize("action", ["x", ["a", "b"], None, [1j, 0]])
def test_an_action_that_is_no_numbers_is_named(action):
    env = RingEnv(senses=("wheels",))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action=.*: give two finite wheel speeds"):
        env.step(action)


def test_an_env_that_is_no_world_is_refused():
    with pytest.raises(ValueError, match=r"env='x' is no env: give Env"):
        GymWorld("x")
    with pytest.raises(ValueError, match=r"task=None is no task: give SequenceTask"):
        GymWorld(gymnasium.Env())


def test_a_world_that_was_not_restored_takes_no_step():
    world = GymWorld(RingEnv(senses=("wheels",)))
    state = world.initial()
    snapshot = world.snapshot(state)
    with pytest.raises(ValueError, match="of another world"):
        world.restore({}, state)
    world.step(torch.zeros(2), state)
    snapshot["env"] = {}
    with pytest.raises(ValueError, match="is no snapshot"):
        world.restore(snapshot, state)
    with pytest.raises(RuntimeError, match="restore a snapshot"):
        world.step(torch.zeros(2), state)

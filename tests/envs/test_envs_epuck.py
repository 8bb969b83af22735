"""The simulated e-puck: exactness first, then optics, physics, judge and reward."""

import colorsys
import math
import os
import pickle
import subprocess
import sys
import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("pybullet")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from dntorch.body import Body  # noqa: E402
from dntorch.colors import HUES  # noqa: E402
from dntorch.envs import EPuckEnv, Light, Ring, SequenceTask  # noqa: E402

PIVOTS = ["free", "kinematic"]


@pytest.fixture
def make():
    """Build envs that are closed when the test ends."""
    built = []

    def build(**arguments):
        built.append(EPuckEnv(**arguments))
        return built[-1]

    yield build
    for env in built:
        env.close()


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
    found = []
    for _ in range(limit):
        same = env.bearings[env.layout == env.colors.index(color)]
        bearing = same[np.abs(same).argmin()]
        *step, info = env.step(env.body.spin(np.clip(gain * bearing, -0.9, 0.9)))
        if info["found"] >= 0:
            found.append(env.colors[info["found"]])
            return found[-1], step[1], info
    raise AssertionError(f"{color} was not found in {limit} steps")


def hold(env, steps, yaw_rate=0.0):
    """Infos and rewards of turning at one rate."""
    outcomes = [env.step(env.body.spin(yaw_rate)) for _ in range(steps)]
    return [outcome[4] for outcome in outcomes], [outcome[1] for outcome in outcomes]


# ---------------------------------------------------------------------- exactness


@pytest.mark.parametrize("pivot", PIVOTS)
def test_same_seed_same_bytes(make, pivot):
    first, second = make(pivot=pivot), make(pivot=pivot)
    first.reset(seed=5)
    expected = wander(first, 60)
    second.reset(seed=9)
    wander(second, 30, seed=1)
    first.reset(seed=9)
    second.reset(seed=5)
    assert wander(second, 60) == expected
    first.reset(seed=5)
    assert wander(first, 60) == expected


def test_seed_decides_the_layout_and_another_reset_draws_another(make):
    env = make(pivot="kinematic")
    layouts = []
    for seed in (1, 2, None, 1, None):
        env.reset(seed=seed)
        layouts.append(env.layout.tolist())
    assert layouts[0] == layouts[3] and layouts[2] != layouts[1]
    assert layouts[0] != layouts[1] and layouts[4] != layouts[3]
    assert all(sorted(layout) == sorted([0, 1, 2, 3] * 4) for layout in layouts)


def test_layout_seed_fixes_the_layout(make):
    env = make(pivot="kinematic", layout_seed=4)
    env.reset(seed=1)
    layout = env.layout.tolist()
    env.reset(seed=2)
    assert env.layout.tolist() == layout


RESUME = """
import pickle, sys
sys.path.insert(0, {tests!r})
from test_envs_epuck import EPuckEnv, wander
state, pivot, busy = pickle.load(sys.stdin.buffer)
env = EPuckEnv(pivot=pivot)
if busy:
    env.reset(seed=77)
    wander(env, 25, seed=3)
env.load_state_dict(state)
seen = env.observe()
after = wander(env, 60, seed=2)
env.reset()
sys.stdout.buffer.write(pickle.dumps((seen, after, env.layout.tolist())))
"""


@pytest.mark.parametrize("pivot, busy", [("free", False), ("free", True), ("kinematic", False)])
def test_snapshot_resumes_exactly_in_a_fresh_process(make, pivot, busy):
    plain, saved = make(pivot=pivot), make(pivot=pivot)
    for env in (plain, saved):
        env.reset(seed=11)
        wander(env, 83)
        observation, *_ = env.step([0.4, 0.3])
    state = saved.state_dict()
    expected = wander(plain, 60, seed=2)
    assert wander(saved, 60, seed=2) == expected, "taking a snapshot changed the run"
    plain.reset()
    code = RESUME.format(tests=os.path.dirname(os.path.abspath(__file__)))
    message = pickle.dumps((state, pivot, busy))
    reply = subprocess.run(
        [sys.executable, "-c", code], input=message, stdout=subprocess.PIPE, check=True
    )
    seen, after, layout = pickle.loads(reply.stdout)
    assert all(np.array_equal(seen[key], observation[key]) for key in observation)
    assert after == expected
    assert layout == plain.layout.tolist()


def test_snapshot_holds_judge_and_reward(make):
    first, second = make(pivot="kinematic"), make(pivot="kinematic", render_mode="rgb_array")
    first.reset(seed=0)
    for color in "GBYRG":
        turn_to(first, color)
    hold(first, 10)
    second.load_state_dict(pickle.loads(pickle.dumps(first.state_dict())))
    infos, rewards = hold(second, 40)
    assert rewards == hold(first, 40)[1] == [2.0] * 21 + [0.0] * 19
    assert all(info["found"] == -1 for info in infos), "the visit was counted before"


def test_snapshot_of_another_world_is_refused(make):
    first, second = make(pivot="kinematic"), make(pivot="kinematic", ring=Ring(radius=0.5))
    first.reset(seed=0)
    with pytest.raises(ValueError, match="another world: build EPuckEnv"):
        second.load_state_dict(first.state_dict())


def test_render_disturbs_nothing(make):
    plain, drawn = make(), make(render_mode="rgb_array")
    records = []
    for env in (plain, drawn):
        env.reset(seed=2)
        record = []
        for k in range(12):
            picture = env.render()
            record += wander(env, 3, seed=k)
        records.append(record)
    assert records[0] == records[1]
    assert picture.shape == (360, 480, 3) and picture.dtype == np.uint8
    assert plain.render() is None


# ---------------------------------------------------------------------- conventions


@pytest.mark.parametrize("pivot", PIVOTS)
def test_gymnasium_checker_is_content(pivot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Wheel speeds are in rad/s; gymnasium.wrappers.RescaleAction serves who wants [-1, 1].
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")
        env = gymnasium.make("dntorch.envs:dntorch/EPuck-v0", pivot=pivot)
        check_env(env.unwrapped)
        env.close()


def test_gymnasium_make_knows_the_id():
    env = gymnasium.make("dntorch.envs:dntorch/EPuck-v0", ring=Ring(8), max_seconds=0.25)
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(8)]
    assert ends == [(False, False)] * 7 + [(False, True)]
    env.close()


def test_info_is_numpy_of_fixed_dtype_every_step(make):
    env = make(pivot="kinematic")
    _, info = env.reset(seed=0)
    dtypes = {key: value.dtype for key, value in info.items()}
    assert dtypes["found"] == np.int64 and dtypes["bearing"] == np.float64
    for outcome in hold(env, 5, 0.5)[0]:
        assert {key: value.dtype for key, value in outcome.items()} == dtypes


def test_importing_and_running_prints_nothing_and_needs_no_pybullet_at_first():
    code = """
import sys, dntorch.envs
assert "pybullet" not in sys.modules and "dntorch.envs.epuck" not in sys.modules
from dntorch.envs import EPuckEnv
env = EPuckEnv(render_mode="rgb_array")
env.reset(seed=0); env.step([0.1, 0.2]); env.render(); env.close(); env.close()
EPuckEnv()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == b"" and done.stderr == b""


def test_missing_pybullet_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(ImportError, match=r"pip install 'dntorch\[sim\]'"):
        EPuckEnv()


def test_close_twice_and_clear_errors_around_it(make):
    env, other = make(), make()
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step([0, 0])
    env.reset(seed=0)
    other.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step([0, 0])
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="build a new one"):
        env.reset()
    other.step([0, 0])


# ---------------------------------------------------------------------- camera and sensors


def hues(image):
    """Hues in degrees of the coloured pixels of an image."""
    pixels = {tuple(pixel) for pixel in image.reshape(-1, 3) / 255}
    colored = [colorsys.rgb_to_hsv(*pixel) for pixel in pixels]
    return {round(hue * 360) for hue, saturation, _ in colored if saturation > 0.3}


def test_image_shows_nothing_but_the_hues_of_the_blocks(make):
    env = make(task=SequenceTask("RO", "ROYGBVCM"), ring=Ring(16, block_shape="mixed"))
    env.reset(seed=0)
    seen = set()
    for _ in range(30):
        observation, *_ = env.step(env.body.spin(0.97))
        seen |= hues(observation["image"])
        for _ in range(6):
            env.step(env.body.spin(0.97))
    assert all(min(abs(hue - pure) for pure in HUES.values()) <= 2 for hue in seen)
    assert len({min(HUES, key=lambda c: abs(HUES[c] - hue)) for hue in seen}) == 8


@pytest.mark.parametrize("shape", ["box", "cylinder", "sphere", "mixed"])
def test_block_appears_in_the_column_of_its_bearing(make, shape):
    env = make(pivot="kinematic", ring=Ring(block_shape=shape, block_size=0.06))
    env.reset(seed=0)
    for _ in range(40):
        observation, *_, info = env.step(env.body.spin(0.3))
        column = (env.body.width - 1) / 2 - env.body.focal * math.tan(info["bearing"])
        image = observation["image"].astype(int)
        colored = np.ptp(image, axis=2).max(axis=0) > 60
        around = np.flatnonzero(colored & (abs(np.arange(52) - column) < 7))
        assert abs(around.mean() - column) < 1.5


def test_image_is_upright_and_left_is_left(make):
    env = make(pivot="kinematic", ring=Ring(4))
    observation, info = env.reset(seed=0)
    assert info["bearing"] != 0 and not np.ptp(observation["image"].astype(int), axis=2).any()
    assert observation["image"][0].mean() > observation["image"][-1].mean() + 50
    env.step(env.body.spin(0.8))
    hold(env, 20, 0.8)
    observation, *_, info = env.step(env.body.spin(0.8))
    assert 0.1 < info["bearing"] < 0.4, "the block ahead on the left"
    columns = np.flatnonzero(np.ptp(observation["image"].astype(int), axis=2).any(axis=0))
    assert len(columns) and columns.mean() < 26


@pytest.mark.parametrize("width, height, fov", [(40, 40, 0.336), (160, 120, 0.656), (7, 5, 1.5)])
def test_other_cameras(make, width, height, fov):
    env = make(body=Body(width=width, height=height, fov=fov))
    observation, _ = env.reset(seed=0)
    assert observation["image"].shape == (height, width, 3)
    assert observation in env.observation_space


def test_light_changes_the_image_and_does_not_stick(make):
    bright, dark = make(), make(light=Light(ambient=0.2, diffuse=0.2, color=(1, 0.8, 0.6)))
    first = bright.reset(seed=0)[0]["image"]
    assert dark.reset(seed=0)[0]["image"].mean() < first.mean() - 20
    assert np.array_equal(bright.observe()["image"], first)


def test_proximity_sees_a_near_block_and_nothing_far(make):
    far = make().reset(seed=0)[0]["proximity"]
    assert np.allclose(far, 67.19)
    env = make(ring=Ring(4, radius=0.16), tolerance=0.1)
    env.reset(seed=0)
    while abs(env.pose.yaw - math.pi / 4) > 0.02:
        observation, *_ = env.step(env.body.spin(0.4))
    for _ in range(60):
        observation, *_ = env.step([1.26, 1.26])
    front = observation["proximity"][[0, 7]]
    assert (front > 100).all() and observation["proximity"][[3, 4]].max() < 68


# ---------------------------------------------------------------------- motion


@pytest.mark.parametrize("pivot, slip", [("free", 0.01), ("kinematic", 1e-3)])
@pytest.mark.parametrize("yaw_rate", [0.25, -0.9])
def test_yaw_follows_the_wheels_and_the_robot_stays(make, pivot, slip, yaw_rate):
    env = make(pivot=pivot)
    env.reset(seed=0)
    infos, _ = hold(env, 320, yaw_rate)
    turned = sum(float(info["yaw_rate"]) for info in infos) * env.dt
    left, right = env.observe()["wheels"] * (2 * math.pi / 1000)
    assert turned == pytest.approx(env.body.yaw_rate(left, right), rel=slip)
    assert turned == pytest.approx(10 * yaw_rate, rel=slip)
    assert np.linalg.norm(env.pose.position) < 0.001


def test_only_the_free_robot_drives_ahead(make):
    for pivot, way in (("free", 0.02), ("kinematic", 0.0)):
        env = make(pivot=pivot)
        env.reset(seed=0)
        for _ in range(32):
            observation, *_ = env.step([1.0, 1.0])
        assert env.pose.position[0] == pytest.approx(way, abs=1e-3)
        assert observation["wheels"] == pytest.approx([1000 / (2 * math.pi)] * 2, abs=1)


def test_actions_are_clipped(make):
    env = make(pivot="kinematic")
    env.reset(seed=0)
    for _ in range(32):
        env.step([-50.0, 50.0])
    assert env.observe()["wheels"].tolist() == [-201.0, 201.0]


@pytest.mark.parametrize("action", [[np.nan, 0], [0, np.inf], [1.0], [[0, 0]], 3.0])
def test_bad_actions_are_refused(make, action):
    env = make(pivot="kinematic")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action=.*give two finite"):
        env.step(action)


# ---------------------------------------------------------------------- found and rewarded


@pytest.mark.parametrize("pivot", PIVOTS)
def test_sequence_is_rewarded_exactly_at_completion_for_its_duration(make, pivot):
    env = make(pivot=pivot)
    env.reset(seed=3)
    for color in "GBYR":
        assert turn_to(env, color)[0] == color
        infos, rewards = hold(env, 40)
        assert all(info["found"] == -1 for info in infos), "a visit counts once"
        assert not any(rewards)
    color, reward, info = turn_to(env, "G")
    assert (color, reward, bool(info["completed"])) == ("G", 2.0, True)
    infos, rewards = hold(env, 40)
    assert rewards == [2.0] * 31 + [0.0] * 9
    assert not any(info["completed"] for info in infos)


def test_wrong_color_is_found_as_what_it_is(make):
    env = make(pivot="kinematic")
    env.reset(seed=3)
    assert [turn_to(env, color)[0] for color in "GBRYG"] == list("GBRYG")
    assert not any(hold(env, 40)[1])


@pytest.mark.parametrize("pivot", PIVOTS)
def test_scanning_past_never_counts(make, pivot):
    env = make(pivot=pivot)
    env.reset(seed=0)
    infos, _ = hold(env, 820, 0.25)
    assert all(info["found"] == -1 for info in infos)
    centered = [int(info["centered"]) for info in infos]
    assert set(centered) == {-1, 0, 1, 2, 3}, "all colours passed"


def test_standing_still_after_reset_finds_nothing(make):
    env = make()
    env.reset(seed=0)
    assert all(info["found"] == -1 for info in hold(env, 64)[0])


@pytest.mark.parametrize("colors, sequence", [("RGB", "GBRG"), ("ROYGBV", "OGVRYBO")])
def test_three_and_six_colors(make, colors, sequence):
    env = make(pivot="kinematic", task=SequenceTask(sequence, colors))
    env.reset(seed=1)
    assert sorted(env.layout) == sorted(list(range(len(colors))) * 4)
    found = [turn_to(env, color)[::2] for color in sequence]
    assert [color for color, _ in found] == list(sequence)
    assert [bool(info["completed"]) for _, info in found] == [False] * (len(sequence) - 1) + [True]


# ---------------------------------------------------------------------- bad arguments


@pytest.mark.parametrize(
    "arguments, remedy",
    [
        ({"task": "GBYRG"}, "give SequenceTask(...)"),
        ({"ring": 16}, "give Ring(...)"),
        ({"substeps": 2.5}, "give a whole number"),
        ({"layout_seed": -1}, "an integer from 0"),
        ({"pivot": "loose"}, "choose from"),
        ({"tolerance": 0.3}, "less than half a pitch"),
        ({"tolerance": 0.0}, "give a number above 0"),
        ({"dwell": -0.5}, "give a number above 0"),
        ({"dwell_rate": math.inf}, "give a number above 0"),
        ({"render_mode": "human"}, "give 'rgb_array'"),
        ({"max_seconds": 0.0}, "give a number above 0"),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, remedy):
    ((name, value),) = arguments.items()
    with pytest.raises(ValueError) as error:
        EPuckEnv(**arguments)
    message = str(error.value)
    assert f"{name}={value!r}" in message and remedy in message and "\n" not in message


@pytest.mark.parametrize(
    "part, arguments, remedy",
    [
        (Body, {"fov": 4.0}, "below pi"),
        (Body, {"width": 0}, "above 0"),
        (Body, {"height": 39.5}, "whole numbers"),
        (Body, {"speed_cap": math.nan}, "above 0"),
        (SequenceTask, {"sequence": "GXG"}, "use letters of colors"),
        (SequenceTask, {"colors": "RGBQ"}, "choose from"),
        (SequenceTask, {"reward": math.nan}, "give a number"),
        (SequenceTask, {"duration": 0.01}, "give at least dt=0.03125"),
        (SequenceTask, {"dt": 0.0}, "give a number above 0"),
        (Ring, {"blocks": 0}, "give a number above 0"),
        (Ring, {"block_size": 0.2}, "fewer or smaller blocks"),
        (Ring, {"block_size": -1.0}, "give a number above 0"),
        (Ring, {"block_shape": "cone"}, "choose from"),
        (Ring, {"radius": 0.1}, "a larger radius"),
        (Light, {"direction": (0, 0, 0)}, "give a vector"),
        (Light, {"ambient": 1.5}, "from 0 to 1"),
        (Light, {"color": (1, 2, 1)}, "from 0 to 1"),
    ],
)
def test_bad_bodies_and_lights_are_named_with_a_remedy(part, arguments, remedy):
    ((name, value),) = arguments.items()
    with pytest.raises(ValueError) as error:
        part(**arguments)
    assert f"{name}={value!r}" in str(error.value) and remedy in str(error.value)


def test_blocks_that_no_colors_share_are_named_with_a_remedy():
    with pytest.raises(ValueError, match="blocks=15: give a multiple of the 4 colors"):
        EPuckEnv(ring=Ring(15))

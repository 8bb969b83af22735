"""Calibration from frames: of images made by hand, and of the emulated robot."""

import json
import math

import numpy as np
import pytest

from dntorch.colors import HUES
from dntorch.robot import calibration as cal
from dntorch.robot.calibration import Calibration
from dntorch.robot.emulated.camera import Camera

GRAY = np.full((39, 52, 3), 120, np.uint8)


def block(color, wide=12, at=26):
    image = GRAY.copy()
    image[10:30, at - wide // 2 : at + wide // 2] = color
    return image


def test_a_file_holds_it(tmp_path):
    path = tmp_path / "robot.json"
    made = Calibration(90, True, (1.0, 0.8, 0.9), {"R": 4.0, "G": 118.0}, 0.6, 0.0565)
    made.save(path)
    assert Calibration.load(path) == made and path.stat().st_size < 400
    path.write_text("{}")
    assert Calibration.load(path) == Calibration()
    for text in ("[1]", "not json", json.dumps({"unknown": 1}), json.dumps({"gains": 3})):
        path.write_text(text)
        with pytest.raises(ValueError, match="no calibration"):
            Calibration.load(path)


@pytest.mark.parametrize("wrong", [
    {"rotate": 45}, {"rotate": math.nan}, {"rotate": "90"}, {"mirror": "no"}, {"mirror": 1},
    {"gains": [1.0, 0.0, 1.0]}, {"gains": [1.0, 1.0]}, {"gains": [1.0, math.nan, 1.0]},
    {"gains": [1.0, 1.0, 1e9]}, {"gains": "abc"}, {"gains": [[1], [1], [1]]},
    {"fov": 0.0}, {"fov": 7}, {"fov": math.nan}, {"fov": "0.6"}, {"fov": None},
    {"axle": -1.0}, {"axle": 99}, {"axle": math.inf}, {"axle": True},
    {"fps": 0}, {"fps": -3}, {"fps": 1e9}, {"fps": math.nan},
    {"hues": {"R": math.nan}}, {"hues": {"R": "red"}}, {"hues": {"X": 3.0}}, {"hues": {"R": 400}},
    {"hues": [1]}, {"hues": None},
])  # fmt: skip
def test_what_corrects_nothing_is_refused(wrong, tmp_path):
    path = tmp_path / "robot.json"
    path.write_text(json.dumps(wrong))
    (name,) = wrong
    with pytest.raises(
        ValueError, match=rf"robot.json is no calibration: {name[:3]}.*(give|choose|name)"
    ):
        Calibration.load(path)
    if name != "gains":
        with pytest.raises(ValueError, match=f"^{name[:3]}"):
            Calibration(**wrong)


def test_a_distance_is_beyond_the_camera():
    for distance in (0.0, -1.0, 0.03, math.nan):
        with pytest.raises(ValueError, match=r"distance=.* give a number from"):
            cal.measure_view([GRAY, GRAY], [0.0, 0.1], distance)


@pytest.mark.parametrize("rotate", [0, 90, 180, 270])
@pytest.mark.parametrize("mirror", [False, True])
def test_correct_undoes_how_the_camera_is_mounted(rotate, mirror):
    true = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
    mounted = np.rot90(true[:, ::-1] if mirror else true, -rotate // 90)
    assert np.array_equal(Calibration(rotate, mirror).correct(mounted), true)


def test_hue_centers_are_those_of_the_repertoire():
    assert Calibration().hue_centers("RGB") is None
    made = Calibration(hues={"R": 1.0, "G": 2.0, "B": 3.0})
    assert made.hue_centers("BR") == [3.0, 1.0]
    with pytest.raises(ValueError, match="measure Y as well"):
        made.hue_centers("RY")


def test_gray_world_undoes_a_colour_cast():
    cast = Camera((1.4, 1.0, 0.6))
    around = [cast.see(block(c)) for c in ((200, 0, 0), (0, 200, 0), (0, 0, 200), (200, 200, 0))]
    gains = cal.gray_world(around)
    corrected = Calibration(gains=gains).correct(around[0])[0, 0].astype(float)
    assert max(gains) == 1.0 and np.ptp(corrected) < 0.25 * corrected.mean()
    with pytest.raises(ValueError, match="too dark"):
        cal.gray_world([np.zeros((4, 4, 3), np.uint8)])


@pytest.mark.parametrize("color, hue", [
    ((200, 0, 0), 0), ((200, 200, 0), 60), ((0, 200, 0), 120), ((0, 0, 200), 240),
    ((200, 0, 20), 354), ((250, 120, 10), 27.5),
])  # fmt: skip
def test_hue_of_noisy_blocks(color, hue):
    noisy = [Camera(noise=5.0).see(block(color), k) for k in range(3)]
    (letter,) = [k for k in "RYGBO" if abs((HUES[k] - hue + 180) % 360 - 180) < 15]
    difference = cal.measure_hues(noisy, letter)[letter] - hue
    assert abs((difference + 180) % 360 - 180) < 3


def test_a_look_around_calibrates_colours():
    cast = Camera((1.3, 1.0, 0.7), noise=4.0)
    paints = {"R": (200, 30, 20), "Y": (210, 190, 20), "G": (20, 140, 50), "B": (20, 60, 180)}
    around = [cast.see(block(paint), k) for k, paint in enumerate(paints.values())]
    made = cal.calibrate(around, "RYGB", rotate=180)
    assert made.rotate == 180 and made.gains[2] == 1.0
    seen = [made.correct(image) for image in around]
    for letter, image in zip(paints, seen):
        alone = cal.measure_hues([image], letter)[letter]
        assert abs((made.hues[letter] - alone + 180) % 360 - 180) < 3
    with pytest.raises(ValueError, match="'M' is not to be seen"):
        cal.measure_hues(seen, "RYGBM")


# ---------------------------------------------------------------- by turning the robot


@pytest.fixture(scope="module")
def turning():
    """What an emulated e-puck sees while it turns once: images, yaw and wheels."""
    pytest.importorskip("gymnasium")
    from dntorch.body import Body
    from dntorch.envs import RingEnv

    env = RingEnv(body=Body(axle=0.0568, fov=0.656))
    observation, _ = env.reset(seed=2)
    seen = [(observation["image"], 0.0, 0.0)]
    for _ in range(420):
        observation, *_ = env.step([-1.2, 1.2])
        wheels = (observation["wheels"] @ (-1, 1)) * math.tau / 1000
        seen.append((observation["image"], wheels * 0.02 / 0.0568, wheels))
    env.close()
    return [list(column) for column in zip(*seen)]


@pytest.mark.parametrize("mirror", [False, True])
def test_turning_shows_the_field_of_view_and_a_mirror(turning, mirror):
    images, yaws, _ = turning
    images = [image[:, ::-1] if mirror else image for image in images]
    fov, mirrored = cal.measure_view(images[:320:2], yaws[:320:2], distance=0.36)
    assert abs(fov - 0.656) < 0.03 and mirrored is mirror
    with pytest.raises(ValueError, match="do not move"):
        cal.measure_view([GRAY, GRAY, GRAY], [0.0, 0.1, 0.2])


def test_a_full_turn_shows_the_axle(turning):
    images, _, wheels = turning
    assert abs(cal.measure_axle(images, wheels) - 0.0568) < 0.0003
    with pytest.raises(ValueError, match="less than a turn"):
        cal.measure_axle(images[:100], wheels[:100])

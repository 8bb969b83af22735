"""Colour vision against OpenCV, and "find colour c" on synthetic images."""

import colorsys
import math
from typing import NamedTuple

import cv2
import numpy as np
import pytest
import torch

from dntorch.cells.color import hue_bins, hue_columns, hue_saturation_value
from dntorch.colors import HUES
from dntorch.modules.field import DNF
from dntorch.modules.find_color import FindColor

# Hue, saturation, value


def random_image():
    return np.random.default_rng(0).integers(0, 256, (200, 300, 3), dtype=np.uint8)


def gradient_image():
    """Ramps of each pair of channels at each level of the third, and all grays."""
    ramp = np.arange(0, 256, 5, dtype=np.uint8)
    cube = np.stack(np.meshgrid(ramp, ramp, ramp, indexing="ij"), -1).reshape(-1, ramp.size, 3)
    grays = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(-1, 1, 3)
    return np.concatenate((cube, np.broadcast_to(grays, (256, ramp.size, 3))))


images = pytest.mark.parametrize(
    "image", [random_image(), gradient_image()], ids=["random", "ramps"]
)


def around(difference, circle):
    """Distance on a circle."""
    return np.abs((difference + circle / 2) % circle - circle / 2)


def hsv(image):
    return [part.numpy() for part in hue_saturation_value(torch.from_numpy(image))]


@images
def test_hue_saturation_and_value_are_those_of_opencv_on_floats(image):
    expected = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2HSV)
    hue, saturation, value = hsv(image)
    assert hue.min() >= 0 and hue.max() < 360
    assert around(hue - expected[..., 0], 360).max() < 2e-3
    np.testing.assert_allclose(saturation, expected[..., 1], atol=1e-5)
    np.testing.assert_allclose(value, expected[..., 2], atol=1e-6)


@images
def test_hue_saturation_and_value_are_those_of_opencv_on_bytes_within_rounding(image):
    expected = cv2.cvtColor(image, cv2.COLOR_RGB2HSV_FULL).astype(float)
    hue, saturation, value = hsv(image)
    assert around(hue * 256 / 360 - expected[..., 0], 256).max() < 1.01
    np.testing.assert_allclose(
        255 * saturation, expected[..., 1], atol=0.53
    )  # a table of divisions
    np.testing.assert_allclose(255 * value, expected[..., 2], atol=1e-3)


def rgb(hue, saturation=1.0, value=1.0):
    return [round(255 * part) for part in colorsys.hsv_to_rgb(hue / 360, saturation, value)]


@pytest.mark.parametrize(("letter", "hue"), HUES.items())
def test_every_color_has_its_hue(letter, hue):
    image = torch.tensor(rgb(hue), dtype=torch.uint8)
    assert float(hue_saturation_value(image)[0]) == pytest.approx(hue, abs=0.3)


def slow_columns(image, hues, min_saturation, min_value):
    height, width, _ = image.shape
    share = np.zeros((hues, width))
    for y, x in np.ndindex(height, width):
        hue, saturation, value = colorsys.rgb_to_hsv(*(image[y, x] / 255))
        if saturation >= min_saturation and value >= min_value:
            share[round(hue * hues) % hues, x] += 1 / height
    return share


@pytest.mark.parametrize(("hues", "saturation", "value"), [(24, 0.35, 0.16), (7, 0.6, 0.5)])
@pytest.mark.parametrize(("height", "width"), [(9, 13), (20, 6)])
def test_columns_are_those_of_a_slow_count(hues, saturation, value, height, width):
    image = np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)
    position = hsv(image)[0] * hues / 360
    image[np.abs(position % 1 - 0.5) < 1e-3] = 0  # on the edge of two bins rounding decides
    actual = hue_columns(torch.from_numpy(image), hues, saturation, value)
    expected = slow_columns(image, hues, saturation, value)
    np.testing.assert_allclose(actual.numpy(), expected, atol=1e-6)
    assert 0 < actual.sum() < width  # some pixels are too gray or too dark


def test_red_on_both_sides_of_zero_is_one_bin():
    image = torch.tensor([[rgb(357.0)], [rgb(3.0)]], dtype=torch.uint8)
    assert hue_columns(image, 24, 0.3, 0.2)[0, 0] == 1


def test_images_of_a_batch_are_counted_apart():
    image = torch.from_numpy(np.random.default_rng(2).integers(0, 256, (2, 3, 5, 8, 3), np.uint8))
    together = hue_columns(image, 24, 0.35, 0.16)
    assert together.shape == (2, 3, 24, 8)
    assert torch.equal(together[1, 2], hue_columns(image[1, 2], 24, 0.35, 0.16))


def exact_bins(image, hues):
    """Bin of each pixel in whole numbers: round a fraction, halves to the even neighbour."""
    channels = image.astype(np.int64)
    value, order = channels.max(-1), channels.argmax(-1)
    chroma = value - channels.min(-1)
    after, next_after = (
        np.take_along_axis(channels, ((order + k) % 3)[..., None], -1)[..., 0] for k in (1, 2)
    )
    over, under = hues * (after - next_after + 2 * order * chroma), 6 * np.maximum(chroma, 1)
    low, rest = np.divmod(over, under)
    up = (2 * rest > under) | ((2 * rest == under) & (low % 2 == 1))
    return (low + up) % hues


@pytest.mark.parametrize("hues", [1, 2, 5, 7, 24, 36, 300])
@images
def test_bins_are_those_of_whole_numbers(image, hues):
    """So that no rounding decides, on any machine, eager or compiled."""
    bins = hue_bins(torch.from_numpy(image), hues, 0.0, 0.0).numpy()
    np.testing.assert_array_equal(bins, exact_bins(image, hues))


@images
def test_too_gray_and_too_dark_pixels_are_in_no_bin(image):
    _, saturation, value = hsv(image)
    bins = hue_bins(torch.from_numpy(image), 24, 0.35, 0.16).numpy()
    np.testing.assert_array_equal(bins == 24, ~((saturation >= 0.35) & (value >= 0.16)))


def test_the_order_of_an_image_in_memory_does_not_matter():
    image = torch.from_numpy(np.random.default_rng(3).integers(0, 256, (2, 9, 8, 3), np.uint8))
    outermost = image.movedim(-1, 0).contiguous().movedim(0, -1)
    assert outermost.stride() != image.stride()
    expected = hue_columns(image, 24, 0.35, 0.16)
    assert torch.equal(hue_columns(outermost, 24, 0.35, 0.16), expected)
    assert torch.equal(hue_columns(image.flip(2), 24, 0.35, 0.16), expected.flip(-1))


def test_an_image_may_be_high_and_hues_many():
    image = torch.zeros(700, 2, 3, dtype=torch.uint8)
    image[:600, :, 2] = 255
    columns = hue_columns(image, 300, 0.35, 0.16)
    assert (columns[200] == 600 / 700).all() and columns.sum() == columns[200].sum()


# Find colour


def scene(*blocks, height=39, width=52):
    """A gray image with blocks ``(letter, left, right)`` in columns of a 52-column image."""
    image = torch.full((height, width, 3), 128, dtype=torch.uint8)
    for letter, left, right in blocks:
        left, right = round(left * width / 52), round(right * width / 52)
        image[height // 4 : -height // 4, left:right] = torch.tensor(
            rgb(HUES[letter]), dtype=torch.uint8
        )
    return image


def want(letters):
    """Intentions, one a letter; a space is none."""
    return torch.tensor([[float(letter == other) for other in "RGBY"] for letter in letters])


class Sight(NamedTuple):
    speed: torch.Tensor
    """Of the right wheel at the end, rad/s, so left is positive."""
    match: torch.Tensor
    lit: torch.Tensor
    """Columns in which the perceptual field is on."""


def look(letters, images, seconds=1.5, body=None):
    """What comes of looking for colours, each in an image of its own."""
    body = (body or FindColor()).resize(len(images))
    images, intentions = torch.stack(images), want(letters)
    for _ in range(round(32 * seconds)):
        left, right = body({"image": images}, intentions).unbind(-1)
        assert torch.equal(left, -right)
    lit = (body.perception.output(body.perception.state) > 0.5).any(1)
    return Sight(right, body.match({"image": images}, body.state), lit)


SCAN = 0.3 * 0.052 / 2 / 0.020
COLUMNS = [2, 10, 16, 21, 26, 32, 40]  # left edges of a block 10 columns wide


@pytest.fixture(scope="module")
def everywhere():
    """Each colour at each place: speeds and matches ``(colours, places, ...)``."""
    letters = [letter for letter in "RGBY" for _ in COLUMNS]
    places = COLUMNS * 4
    images = [scene((x, at, at + 10)) for x, at in zip(letters, places, strict=True)]
    return Sight(*(part.unflatten(0, (4, -1)) for part in look(letters, images)))


def test_it_turns_towards_the_wanted_color(everywhere):
    assert (everywhere.speed.diff() < 0).all()
    assert (everywhere.speed[:, :3] > 0).all() and (everywhere.speed[:, 4:] < 0).all()
    assert (everywhere.speed[:, 0] > SCAN).all()


def test_match_rises_only_for_the_wanted_color_in_the_center(everywhere):
    center = COLUMNS.index(21)
    for own in range(4):
        match = everywhere.match[own]
        assert match[center, own] == 1
        match[center, own] = 0
        assert match.max() < 0.3
    assert look("B", [scene(("G", 21, 31))]).match.max() < 0.05


def test_it_ignores_other_colors():
    block, others = ("B", 10, 20), [("R", 0, 8), ("G", 22, 30), ("Y", 40, 50)]
    crowd, alone = look("BB", [scene(block, *others), scene(block)]).speed
    assert crowd == pytest.approx(float(alone), rel=0.02)


def test_it_scans_at_a_constant_rate_while_it_sees_nothing_wanted():
    sight = look("BB", [scene(), scene(("R", 5, 15), ("G", 30, 40))])
    assert sight.speed.tolist() == pytest.approx([SCAN, SCAN], rel=0.02)


def test_it_stands_still_without_an_intention():
    sight = look("  ", [scene(), scene(("B", 5, 15))])
    assert not sight.speed.any() and sight.match.max() < 0.05
    assert not sight.lit.any()  # the image alone stays below threshold


def test_an_intention_alone_sees_nothing():
    assert not look("RGBY", [scene()] * 4).lit.any()


TWO = [scene(("B", 8, 18), ("B", 38, 46)), scene(("B", 8, 18))]


def test_of_two_fitting_blocks_one_wins():
    two, alone = (sight := look("BB", TWO)).speed
    assert two == pytest.approx(float(alone), rel=0.05)
    assert sight.lit[0, :20].any() and not sight.lit[0, 20:].any()


def test_without_lateral_interaction_it_aims_between_two_blocks():
    body = FindColor()
    for field in body.modules():
        if isinstance(field, DNF):
            field.kernel = ()
    two, alone = (sight := look("BB", TWO, body=body)).speed
    assert abs(two) < 0.4 * alone
    assert sight.lit[0, :20].any() and sight.lit[0, 38:].any()


def test_it_centers_what_it_wants_and_then_reports_it():
    """The closed loop: turning moves the image."""
    body, focal, yaw, matches = FindColor(), 26 / math.tan(0.42), 0.0, []
    for _ in range(32 * 6):
        bearing = 0.7 - yaw
        center = 26 - focal * math.tan(bearing)
        left, right = (min(52, max(0, round(center + half))) for half in (-5, 5))
        image = scene(("B", left, right)) if left < right else scene()
        left, right = body({"image": image}, want("B")[0])
        yaw += float(right - left) * 0.020 / 0.052 / 32
        matches.append(float(body.match({"image": image}, body.state)[2]))
    assert matches[0] < 0.1 and matches[-1] == 1  # out of sight at first
    assert abs(bearing) < 0.05


BLOCKS = [("G", 6, 16), ("G", 21, 31), ("G", 36, 46)]


@pytest.mark.parametrize(("height", "width"), [(20, 26), (40, 61), (78, 104), (120, 160)])
def test_images_of_any_size_mean_the_same(height, width):
    usual = look("GGG", [scene(block) for block in BLOCKS])
    other = look("GGG", [scene(block, height=height, width=width) for block in BLOCKS])
    torch.testing.assert_close(other.speed, usual.speed, atol=0.06, rtol=0)
    torch.testing.assert_close(other.match, usual.match, atol=0.3, rtol=0)


def test_a_calibrated_camera_sees_its_own_hues():
    image = torch.full((39, 52, 3), 128, dtype=torch.uint8)
    image[10:30, 5:15] = torch.tensor(rgb(90.0), dtype=torch.uint8)  # a yellowish green
    assert look("G", [image]).speed == pytest.approx(SCAN, rel=0.02)
    calibrated = FindColor(hue_centers=[0.0, 90.0, 240.0, 40.0])
    assert look("G", [image], body=calibrated).speed > 1.2 * SCAN


@pytest.mark.parametrize(
    "image",
    [
        torch.zeros(39, 52, 3),
        torch.zeros(39, 52, 3, dtype=torch.int64),
        torch.zeros(39, 52, dtype=torch.uint8),
        torch.zeros(3, 39, 52, dtype=torch.uint8),
        torch.zeros(39, 52, 4, dtype=torch.uint8),
    ],
    ids=["float", "long", "gray", "channels first", "alpha"],
)
def test_what_is_no_image_is_refused_with_a_remedy(image):
    with pytest.raises(ValueError, match=r"image of shape \[.*\] and dtype .*: give uint8 RGB"):
        FindColor()({"image": image}, want("B")[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colors": "RGBX"}, "colors='RGBX' has the unknown letter 'X'"),
        ({"colors": "R"}, "colors='R': give two or more"),
        ({"colors": "RO", "hues": 6}, "hues=6: two of the colours .* take more hues"),
    ],
)
def test_wrong_arguments_name_argument_value_and_remedy(options, message):
    with pytest.raises(ValueError, match=message):
        FindColor(**options)

"""What one robot's camera and wheels are like: a small file, made from its own frames."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from dntorch.body import AXLE, DISTANCE, EPUCK, FOV, RATE
from dntorch.colors import HUES, MIN_SATURATION, MIN_VALUE
from dntorch.quantities import Interval, check_vector

TURN = Interval(0, 270, whole=True)
GAIN, HUE = Interval(0, 100, above=True), Interval(0, 360, unit="degrees")


@dataclass(frozen=True)
class Calibration:
    """What to correct; the default corrects nothing.

    `correct` applies the first three to every image, and ``HardwareEnv`` shows it as large as
    ``fov`` says. The rest is for the agent: `dntorch.drive.fit.fit`.

    Raises:
        ValueError: a value that corrects nothing sensible, at once or from a file.
    """

    rotate: int = 0
    """degrees counter-clockwise: 0, 90, 180 or 270"""
    mirror: bool = False
    """left and right are exchanged, after the rotation"""
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """of red, green, blue"""
    hues: dict[str, float] = field(default_factory=dict)
    """degrees, by letter, as they look after the gains"""
    fov: float = EPUCK.fov
    """rad, horizontal, after the rotation"""
    axle: float = EPUCK.axle
    """m, as the turning of the robot shows it"""
    fps: float = 32.0
    """images/s that come"""

    def __post_init__(self) -> None:
        FOV.check("fov", self.fov)
        AXLE.check("axle", self.axle)
        RATE.check("fps", self.fps)
        if self.rotate not in TURN or self.rotate % 90:
            raise ValueError(f"rotate={self.rotate!r}: choose 0, 90, 180 or 270")
        if not isinstance(self.mirror, bool):
            raise ValueError(f"mirror={self.mirror!r}: choose true or false")
        check_vector("gains", self.gains, GAIN)
        if not isinstance(self.hues, dict):
            raise ValueError(f"hues={self.hues!r}: give degrees by letter")
        for letter, hue in self.hues.items():
            if letter not in HUES:
                raise ValueError(f"hues={self.hues!r}: name colours by {', '.join(HUES)}")
            HUE.check(f"hues[{letter!r}]", hue)

    def correct(self, image: np.ndarray) -> np.ndarray:
        """An image as the camera should have seen it, uint8 RGB."""
        image = np.rot90(image, self.rotate // 90)
        image = image[:, ::-1] if self.mirror else image
        if self.gains == (1.0, 1.0, 1.0):
            return np.ascontiguousarray(image)
        bright = image * np.array(self.gains, np.float32)
        return np.rint(bright.clip(0, 255)).astype(np.uint8)

    def hue_centers(self, colors: str) -> list[float] | None:
        """Hues for a repertoire; ``None`` if none was measured.

        Raises:
            ValueError: some were measured, but not all.
        """
        if not self.hues:
            return None
        missing = [letter for letter in colors if letter not in self.hues]
        if missing:
            raise ValueError(f"hues={self.hues}: measure {', '.join(missing)} as well")
        return [self.hues[letter] for letter in colors]

    def save(self, path: str | Path) -> None:
        from dntorch.files import write_json  # imports PyTorch

        write_json(Path(path), asdict(self))

    @classmethod
    def load(cls, path: str | Path) -> "Calibration":
        if not Path(path).is_file():
            raise ValueError(f"calibration={path} is no file: let dntorch robot calibrate make it")
        try:
            values = json.loads(Path(path).read_text(encoding="utf-8"))
            return cls(**{**values, "gains": tuple(values.get("gains", (1.0, 1.0, 1.0)))})
        except (TypeError, AttributeError, ValueError, RecursionError) as error:
            raise ValueError(f"{path} is no calibration: {error}") from error


def gray_world(images: Sequence[np.ndarray]) -> tuple[float, float, float]:
    """Gains that make the world gray on average; none makes an image brighter than it was.

    Take images all around: what is on one side may be of one colour.
    """
    means = np.mean([image.reshape(-1, 3).mean(0) for image in images], axis=0)
    if means.min() < 1:
        raise ValueError(f"mean colour {means.round(1)}: too dark to balance; give more light")
    red, green, blue = (means.min() / means).tolist()
    return red, green, blue


def measure_hues(images: Sequence[np.ndarray], colors: str) -> dict[str, float]:
    """Hue in degrees of each colour among things that all have one of ``colors``.

    Every coloured pixel counts for the letter whose hue is nearest.

    Raises:
        ValueError: a colour is not to be seen.
    """
    import torch  # to measure colours as an agent sees them; driving does without

    from dntorch.cells.color import hue_saturation_value

    parts = hue_saturation_value(torch.from_numpy(np.stack(images)))
    angle, saturation, value = (part.numpy() for part in parts)
    angle = angle[(saturation >= MIN_SATURATION) & (value >= MIN_VALUE)]
    nominal = np.array([HUES[letter] for letter in colors])
    away = (angle[:, None] - nominal + 180) % 360 - 180
    nearest = np.abs(away).argmin(1)
    hues = {}
    for k, letter in enumerate(colors):
        mine = away[nearest == k, k]
        if len(mine) < 1e-4 * saturation.size:
            raise ValueError(f"{letter!r} is not to be seen in {len(images)} images: show it")
        hues[letter] = float((nominal[k] + np.median(mine)) % 360)
    return hues


def calibrate(images: Sequence[np.ndarray], colors: str, **known) -> Calibration:
    """White balance and hues from images all around the robot.

    Args:
        images: as they came, RGB.
        colors: letters of all the colours around.
        known: what else is known of the robot, as the arguments of `Calibration`.
    """
    gains = gray_world(images)
    made = Calibration(gains=gains, **known)
    hues = measure_hues([made.correct(image) for image in images], colors)
    return Calibration(gains=gains, hues=hues, **known)


def measure_view(
    images: Sequence[np.ndarray], yaws: Sequence[float], distance: float = math.inf
) -> tuple[float, bool]:
    """Field of view in rad, and whether images are mirrored, from turning on the spot.

    Args:
        images: while turning, a few degrees apart.
        yaws: rad, counter-clockwise, for each.
        distance: m, from the middle of the robot to what is seen. The camera stands before
            the axle, so near things seem to move faster.
    """
    if not math.isinf(distance):
        DISTANCE.check("distance", distance)
    shifts = np.array([_shift(a, b) for a, b in zip(images, images[1:])])
    ratio = 1.0 if math.isinf(distance) else distance / (distance - EPUCK.camera[0])
    turned = np.diff(yaws) * ratio
    focal = float((shifts @ turned) / (turned @ turned))  # left is +: things move to the right
    if not abs(focal) > 1:
        raise ValueError("the images do not move with the robot: turn among things to look at")
    return 2 * math.atan(images[0].shape[1] / 2 / abs(focal)), focal < 0


def measure_axle(
    images: Sequence[np.ndarray], wheels: Sequence[float], wheel_radius: float = EPUCK.wheel_radius
) -> float:
    """Axle in m from a little more than one turn on the spot.

    Args:
        images: the last ones see again what the first one saw.
        wheels: rad, right wheel minus left wheel, for each image.
    """
    turned = np.abs(np.array(wheels) - wheels[0])
    first = images[0].astype(np.float32)
    unlike = np.array([np.square(image - first).mean() for image in images])
    late = turned > 0.75 * math.tau * EPUCK.axle / wheel_radius
    if not late[:-1].any():
        raise ValueError("less than a turn: go on until the robot sees its first image again")
    best = int(np.where(late, unlike, np.inf).argmin())
    return float(turned[best] * wheel_radius / math.tau)


def _shift(before: np.ndarray, after: np.ndarray) -> float:
    """Columns by which things moved to the right, to a fraction."""
    wide = before.shape[1]
    a, b = (image.mean(0) - image.mean((0, 1)) for image in (before, after))
    reach = range(-wide // 3, wide // 3 + 1)
    unlike = np.array([_difference(a, b, shift) for shift in reach])
    best = int(unlike[1:-1].argmin()) + 1
    left, middle, right = unlike[best - 1 : best + 2]
    bend = left - 2 * middle + right
    if not bend > 0:
        return 0.0  # nothing to go by
    return reach[best] + 0.5 * (left - right) / bend


def _difference(a: np.ndarray, b: np.ndarray, shift: int) -> float:
    wide = len(a)
    kept = a[max(0, -shift) : wide - max(0, shift)]
    return float(np.square(kept - b[max(0, shift) : wide - max(0, -shift)]).mean())

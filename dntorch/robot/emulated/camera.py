"""A camera worse than a simulated one: colour cast, dim or bright, blurred, noisy, slow."""

import math
from dataclasses import dataclass

import numpy as np

from dntorch.quantities import Interval
from dntorch.robot.images import resample

LIMITS = {
    "exposure": Interval(0, 1000, above=True),
    "blur": Interval(0, 1000, unit="px"),
    "noise": Interval(0, 1000),
    "zoom": Interval(1, 1000),
    "fps": Interval(0, 1000, above=True, unit="images/s"),
    "latency": Interval(0, 3600, unit="s"),
}


@dataclass(frozen=True)
class Camera:
    """What a camera does to what it sees; the default is perfect.

    RGB565 is no part of it: every protocol sends such pixels.

    Raises:
        ValueError: a number that makes no camera.
    """

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """of red, green, blue: the white balance is off unless all are the same"""
    exposure: float = 1.0
    """brightness; what comes out above 255 is cut off"""
    blur: float = 0.0
    """px of the image, standard deviation of the defocus"""
    noise: float = 0.0
    """standard deviation of a pixel, of 255"""
    zoom: float = 1.0
    """only the middle ``1/zoom`` of the image is seen, enlarged"""
    fps: float | None = None
    """images/s; ``None``: as many as are asked for"""
    latency: float = 0.0
    """s from light to first byte"""
    seed: int = 0
    """of the noise"""

    def __post_init__(self) -> None:
        for k, gain in enumerate(self.gains):
            LIMITS["exposure"].check(f"gains[{k}]", gain)
        for name, limits in LIMITS.items():
            value = getattr(self, name)
            if name != "fps" or value is not None:
                limits.check(name, value)

    @property
    def clear(self) -> bool:
        """Whether every image comes out as it was."""
        same = self.exposure * np.array(self.gains) == 1
        return bool(same.all()) and self.blur == self.noise == 0 and self.zoom == 1

    def fov(self, fov: float) -> float:
        """rad, what is left of a field of view."""
        return 2 * math.atan(math.tan(fov / 2) / self.zoom)

    def see(self, image: np.ndarray, number: int = 0) -> np.ndarray:
        """What comes out for an image, uint8 ``(height, width, 3)``; noise goes by ``number``."""
        if self.clear:
            return image
        tall, wide = image.shape[:2]
        seen = resample(image, wide, tall, self.zoom).astype(np.float32)
        if self.blur > 0:
            import cv2  # comes with the simulation; a real robot does without

            seen = cv2.GaussianBlur(seen, (0, 0), self.blur)
        seen = seen * (self.exposure * np.array(self.gains, np.float32))
        if self.noise > 0:
            random = np.random.default_rng((self.seed, number))
            seen = seen + self.noise * random.standard_normal(seen.shape, np.float32)
        return np.rint(seen.clip(0, 255)).astype(np.uint8)


#: A fair camera: a slight cast, a little dark, soft, noisy; 8 images a second.
MILD = Camera((1.1, 1.0, 0.9), exposure=0.8, blur=1.0, noise=6.0, fps=8.0)

#: A bad one: strong cast, dark, blurred, noisy, narrow; 5 images a second, each 0.2 s late.
HARD = Camera((1.5, 1.0, 0.6), exposure=0.7, blur=2.0, noise=20.0, zoom=1.55, fps=5.0, latency=0.2)

CAMERAS = {"ideal": Camera(), "mild": MILD, "hard": HARD}

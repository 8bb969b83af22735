"""The body of the e-puck: its sizes and its camera, in one place.

Numbers follow ``E-puck.proto`` and ``e-puck.md`` of Webots (Cyberbotics). Frame of the
robot: origin on the floor below the middle of the axle, x forward, y left, z up; angles
count counter-clockwise.
"""

import math
from dataclasses import dataclass

from dntorch.quantities import Interval, check_quantities, check_vector

#: Motor steps in one turn of a wheel.
STEPS_PER_TURN = 1000

#: Motor steps/s above which an e-puck1 and an e-puck2 cut off a speed (MOTOR_SPEED_LIMIT).
EPUCK1_LIMIT, EPUCK2_LIMIT = 1000, 1100

#: rad/s, fastest turning of a wheel: 1000 motor steps/s, rounded down.
FASTEST = 6.28

#: What a robot may be measured to be: field of view, axle, images that come, distance of what
#: it sees from its middle.
FOV, AXLE = Interval(0.05, 3, unit="rad"), Interval(0.01, 0.2, unit="m")
RATE, DISTANCE = Interval(0.1, 1000, unit="images/s"), Interval(0.05, 10, unit="m")


@dataclass(frozen=True)
class Body:
    """Sizes of one robot: the e-puck of Webots unless you say otherwise.

    Real robots differ: a calibrated axle is up to 0.057 m, a real camera sees as little
    as 0.34 rad.

    Raises:
        ValueError: a size is not positive, or ``fov`` is not below pi.
    """

    wheel_radius: float = 0.020
    """m"""
    axle: float = 0.052
    """m, from wheel to wheel"""
    radius: float = 0.037
    """m, of the round body"""
    mass: float = 0.15
    """kg, all together"""
    speed_cap: float = 1.26
    """rad/s, largest wheel speed that is obeyed (200 motor steps/s, a fifth of `FASTEST`)"""
    camera: tuple[float, float, float] = (0.030, 0.0, 0.028)
    """m, place of the camera, which looks along +x"""
    fov: float = 0.84
    """rad, horizontal field of view"""
    width: int = 52
    """px, columns of the image"""
    height: int = 39
    """px, rows of the image"""
    near: float = 0.0055
    """m, nearest distance the camera sees"""

    def __post_init__(self) -> None:
        check_quantities(
            wheel_radius=self.wheel_radius, axle=self.axle, radius=self.radius, mass=self.mass,
            speed_cap=self.speed_cap, near=self.near, fov=self.fov, width=self.width,
            height=self.height,
        )  # fmt: skip
        check_vector("camera", self.camera, Interval(-1, 1, unit="m"))
        if self.fov >= math.pi:
            raise ValueError(f"fov={self.fov!r} is no flat image: give radians below pi")
        if int(self.width) != self.width or int(self.height) != self.height:
            raise ValueError(
                f"width={self.width!r}, height={self.height!r}: give whole numbers of pixels"
            )

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.width / 2 / math.tan(self.fov / 2)

    def yaw_rate(self, left: float, right: float) -> float:
        """Turning speed in rad/s, counter-clockwise, for two wheel speeds in rad/s."""
        return (right - left) * self.wheel_radius / self.axle

    def spin(self, yaw_rate: float) -> tuple[float, float]:
        """Wheel speeds (left, right) in rad/s that turn on the spot at ``yaw_rate`` rad/s."""
        speed = yaw_rate * self.axle / (2 * self.wheel_radius)
        return -speed, speed


#: The e-puck of Webots: the body of the simulated robot, and the one that agents expect.
EPUCK = Body()

"""A robot that turns once around and measures its own camera and wheels."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dntorch.body import EPUCK, STEPS_PER_TURN
from dntorch.envs.hardware import HardwareEnv
from dntorch.robot import calibration as measure
from dntorch.robot.calibration import Calibration

TURNS, RATE = 1.2, 0.3
"""A little more than once around, at a rate in rad/s that leaves time for images to come."""


class Views(NamedTuple):
    """What was seen on the way round, an entry an image."""

    images: list[np.ndarray]
    """as they came, RGB"""
    wheels: list[float]
    """rad, right wheel minus left wheel"""
    times: list[float]
    """s, of the clock"""


def look_around(env: HardwareEnv, progress: Callable[[float], Any] = lambda share: None) -> Views:
    """Turn on the spot, `TURNS` times, and stop.

    ``progress`` hears what share of it is done.

    Raises:
        ConnectionError: images stay away for too long.
    """
    env.reset()
    views, link = Views([], [], []), env.frame.link
    whole = math.tau * TURNS * EPUCK.axle / EPUCK.wheel_radius
    speeds, done = np.array(env.body.spin(RATE)), 0.0
    end = env.clock.now() + 4 * TURNS * math.tau / RATE
    while done < whole:
        if env.clock.now() > end:
            raise ConnectionError(
                f"the robot turned {done / whole * TURNS:.2f} times instead of {TURNS}: do images "
                "come, and is anything in its way?"
            )
        if not env.step(speeds)[4]["fresh"]:
            continue
        frame = env.frame
        if frame.link != link:  # counters begin anew, and nobody knows how far it turned meanwhile
            views, link, done = Views([], [], []), frame.link, 0.0
        left, right = frame.steps * (math.tau / STEPS_PER_TURN)
        views.images.append(frame.image)
        views.wheels.append(float(right - left))
        views.times.append(frame.time)
        done = abs(views.wheels[-1] - views.wheels[0])
        progress(min(1.0, done / whole))
    env.step(np.zeros(2))
    return views


def calibrate_from(
    views: Views, colors: str, distance: float | None = None, **known: Any
) -> Calibration:
    """All that one look around tells.

    Args:
        views: of `look_around`.
        colors: letters of all the colours around.
        distance: m, from the middle of the robot to what is seen; measures the field of view
            and whether images are mirrored.
        known: what else is known, as the arguments of `Calibration`; not measured then.

    Raises:
        ValueError: a colour is not to be seen; the images do not fit a turn of the robot.
    """
    upright = Calibration(rotate=known.get("rotate", 0), mirror=known.get("mirror", False))
    images = [upright.correct(image) for image in views.images]
    known.setdefault("fps", round((len(images) - 1) / (views.times[-1] - views.times[0]), 2))
    if "axle" not in known:
        known["axle"] = round(measure.measure_axle(images, views.wheels), 5)
    if distance is not None:
        yaws = np.array(views.wheels) * EPUCK.wheel_radius / known["axle"]
        fov, mirrored = measure.measure_view(images, yaws, distance)
        known.setdefault("fov", round(fov, 4))
        known.setdefault("mirror", mirrored)
    return measure.calibrate(views.images, colors, **known)

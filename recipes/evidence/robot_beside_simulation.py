"""A robot behind its protocol does what the simulated one does, and what makes it differ.

One trained agent, learning off, in several layouts: in the simulated world, and as a robot, that
is, through the hardware env, the driver and the Wi-Fi protocol of an emulator of the same world,
in virtual time. Both see 160x120 pixels of RGB565 through one resampler and turn their wheels by
whole motor steps. With an ideal link they do the same; then one thing after the other is as on
a real robot. You will see, for each layout, which behaviours both completed, how many control
steps apart, and how far wheel speeds and headings were apart at most.

    python recipes/evidence/robot_beside_simulation.py RUN --layouts 5 --behaviors 8
"""

import argparse
import math
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: small arrays

import numpy as np

from dntorch.body import STEPS_PER_TURN, Body
from dntorch.drive import fit as robot
from dntorch.drive.driving import Act, Trip, acting, perform
from dntorch.envs import EPuckEnv
from dntorch.envs.task import NOTHING
from dntorch.process import settle
from dntorch.robot.calibration import Calibration
from dntorch.robot.codecs import rgb565
from dntorch.robot.emulated.camera import Camera
from dntorch.robot.images import resample
from dntorch.robot.safety import Limits
from dntorch.runs.worlds import build_task

BODY = Body(width=160, height=120)
STEP = math.tau / STEPS_PER_TURN
CASES = {
    "ideal link": {"pacing": "request", "slew": math.inf},
    "changes of speed limited": {"pacing": "request"},
    "robot streams by itself": {"pacing": "firmware"},
    "8 images a second": {"pacing": "firmware", "camera": Camera(fps=8.0)},
}


class Simulated(EPuckEnv):
    """The simulated world with the pixels and the motors of a robot."""

    def sense(self, name: str) -> np.ndarray:
        sensed = super().sense(name)
        if name == "image":
            picture = rgb565.Picture(BODY.width, BODY.height, rgb565.encode(sensed))
            return resample(rgb565.decode(picture), 52, 39)
        return sensed

    def move(self, action: np.ndarray):
        return super().move(np.rint(np.asarray(action, np.float64) / STEP) * STEP)


def simulated(act: Act, world: dict, steps: int) -> tuple[list, list]:
    """Wheels and heading after each step, and what was found when."""
    env = Simulated(body=BODY, **world)
    env.reset(seed=0)
    observation, *_ = env.step(np.zeros(2))  # the robot stands until its first image has come
    rows, found = [], []
    for step in range(steps):
        wheels, color = act(observation, 0.0)
        found += [(step, color)] if color != NOTHING else []
        observation, *_, info = env.step(wheels)
        rows.append((*wheels, info["yaw"]))
    env.close()
    return rows, found


def emulated(
    act: Act, world: dict, steps: int, config, scan: float, slew: float = Limits.slew, **link
) -> tuple[list, list]:
    """The same of a robot that is driven."""
    layout, given, rows = world["layout_seed"], [], []
    env, emulator, _ = robot.emulated(
        config, layout, Calibration(), {**world, "body": BODY}, **link
    )
    env.guard.limits, trip = Limits(slew=slew), Trip(config, scan)

    def heard(observation: dict[str, np.ndarray], reward: float) -> tuple[np.ndarray, int]:
        given.append(act(observation, reward))
        return given[-1]

    def look(step) -> None:
        rows.append((*given[-1][0], emulator.world.pose.yaw))

    perform(env, heard, trip, steps, iterations=steps, each=look)
    emulator.world.close()
    return rows, trip.found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of dntorch learn")
    parser.add_argument("--layouts", type=int, default=5)
    parser.add_argument("--behaviors", type=int, default=8, help="steps go on for so many")
    given = parser.parse_args()
    settle()
    trained, config = robot.load_agent(given.run)

    def fresh() -> Act:
        agent = robot.fit(trained, config, Calibration())
        agent.learn(False)
        return acting(agent)

    steps, scan = 150 * given.behaviors, trained.sensorimotor.scan
    for layout in range(given.layouts):
        world = {"layout_seed": layout, "task": build_task(config)}
        ours, found = simulated(fresh(), world, steps)
        for case, link in CASES.items():
            rows, theirs = emulated(fresh(), world, steps, config, scan, **link)
            away = np.array(rows) - np.array(ours)
            away[:, 2] = np.angle(np.exp(1j * away[:, 2]))  # headings wrap around
            away = np.abs(away).max(0)
            letters = ["".join(config.colors[c] for _, c in each) for each in (found, theirs)]
            apart = [abs(a - b) for (a, _), (b, _) in zip(found, theirs)]
            print(
                f"layout {layout}, {case}: simulated {letters[0]}, robot {letters[1]}, at most "
                f"{max(apart, default=0)} steps apart; wheels at most {away[:2].max():.2g} rad/s "
                f"apart, heading {math.degrees(away[2]):.2g} degrees",
                flush=True,
            )


if __name__ == "__main__":
    main()

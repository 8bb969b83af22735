"""An e-puck2 over Wi-Fi for run_agent.py. Needs dntorch[robot] on the computer that drives.

    EPUCK=tcp://192.168.1.1 python run_agent.py DIR --robot epuck.py:EPuck --seconds 60

The robot stops at the end, after an error, and after Ctrl-C or a request to end. To try it
without one: ``dntorch emulate --port 1000`` and EPUCK=tcp://127.0.0.1:1000. What its camera is
like (``calibration=``) and who rewards it (``key=``) are arguments of `HardwareEnv`.
"""

import os

import numpy as np

from dntorch.envs import HardwareEnv
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.transports import transport_for


class EPuck:
    """What run_agent.py wants of a robot, from a `HardwareEnv`."""

    def __init__(self, env: HardwareEnv | None = None) -> None:
        address = os.environ.get("EPUCK", "tcp://192.168.1.1")
        self.env = env or HardwareEnv(Driver(transport_for(address), Wifi()))
        self.env.__enter__()  # from here on the end of the program stops the robot
        self.observation, self.rewarded = self.env.reset()[0], 0.0

    def observe(self) -> dict[str, np.ndarray]:
        return self.observation

    def drive(self, left: float, right: float) -> None:
        """Takes a control step, in which the robot obeys."""
        self.observation, self.rewarded, *_ = self.env.step(np.array([left, right]))

    def reward(self) -> float:
        return self.rewarded

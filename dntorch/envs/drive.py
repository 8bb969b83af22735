"""How the robot moves: on PyBullet's floor, or turning exactly on a pin."""

import math
import os
import tempfile
from typing import Any, Protocol

import numpy as np

from dntorch.body import Body
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene
from dntorch.envs.sensors import two_speeds


def check_speeds(action: np.ndarray, cap: float) -> np.ndarray:
    """Wheel speeds (left, right) in rad/s, clipped to ``cap``, or a ``ValueError``."""
    speeds = two_speeds(action)
    if speeds is None or not np.isfinite(speeds).all():
        raise ValueError(f"action={action!r}: give two finite wheel speeds (left, right) in rad/s")
    return speeds.clip(-cap, cap)


class Drive(Protocol):
    """What moves a robot."""

    wheels: np.ndarray
    """rad, both wheels since the start, left first"""

    def reset(self) -> None: ...
    def step(self, speeds: np.ndarray) -> None:
        """One control step under wheel speeds in rad/s."""

    def pose(self) -> Pose: ...
    def snapshot(self) -> Any: ...
    def restore(self, snapshot: Any) -> None: ...


class Pin:
    """The robot turns without slip on a pin below the middle of its axle.

    Turning is the exact integral of the two wheel speeds; driving ahead only turns the
    wheels, since the pin holds the robot where it is.
    """

    def __init__(self, body: Body, dt: float) -> None:
        self.body, self.dt = body, dt
        self.reset()

    def reset(self) -> None:
        self.wheels = np.zeros(2)

    def step(self, speeds: np.ndarray) -> None:
        self.wheels = self.wheels + speeds * self.dt

    def pose(self) -> Pose:
        yaw = self.body.yaw_rate(*self.wheels)
        c, s = math.cos(yaw), math.sin(yaw)
        return Pose(np.zeros(3), np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))))

    def snapshot(self) -> Any:
        return self.wheels.copy()

    def restore(self, snapshot: Any) -> None:
        self.wheels = np.array(snapshot, np.float64)


class Free:
    """The robot stands on two driven wheels and a slider and is held by friction only.

    Wheels collide as balls: they touch the floor in one point, so the robot turns on the
    spot; wheels of finite width would walk it away by centimetres in 10,000 steps.
    """

    WHEEL_MASS, SLIDER_MASS = 0.005, 0.001  # kg; the hull has the rest
    CENTER_OF_MASS = (-0.003, 0.0, 0.015)  # m; behind the axle: the robot leans on its slider
    TORQUE = 0.005  # N m, the most a motor gives: full speed in 10 ms without spinning the wheels
    GRIP = 2.0  # of rubber tyres; with the 0.5 of PyBullet's floor a friction coefficient of 1
    SETTLE = 64  # control steps to come to rest at the start
    LEFT, RIGHT, SLIDER = 0, 1, 2

    def __init__(self, scene: Scene, body: Body, dt: float, substeps: int) -> None:
        self.bullet, self.client, self.substeps = scene.bullet, scene.client, substeps
        self.bullet.setGravity(0, 0, -9.81, **self.client)
        self.bullet.setPhysicsEngineParameter(
            fixedTimeStep=dt / substeps, deterministicOverlappingPairs=1, **self.client
        )
        self.robot = self._build(body)
        for _ in range(self.SETTLE):
            self.step(np.zeros(2))
        self._start = self.bullet.saveState(**self.client)
        self._angles = self._joints()

    def _build(self, body: Body) -> int:
        b, c = self.bullet, self.client
        hull = b.createCollisionShape(
            b.GEOM_CYLINDER, radius=body.radius, height=0.03,
            collisionFramePosition=(0, 0, 0.03), **c,
        )  # fmt: skip
        wheel = b.createCollisionShape(b.GEOM_SPHERE, radius=body.wheel_radius, **c)
        slider = b.createCollisionShape(b.GEOM_BOX, halfExtents=(0.025, 0.015, 0.004), **c)
        # The camera sits inside the hull: draw the robot as specks behind it, never seen.
        speck = b.createVisualShape(b.GEOM_BOX, halfExtents=(1e-4,) * 3, **c)
        still = (0, 0, 0, 1)
        robot = b.createMultiBody(
            body.mass - 2 * self.WHEEL_MASS - self.SLIDER_MASS, hull, speck, (0, 0, 0),
            baseInertialFramePosition=self.CENTER_OF_MASS,
            linkMasses=(self.WHEEL_MASS, self.WHEEL_MASS, self.SLIDER_MASS),
            linkCollisionShapeIndices=(wheel, wheel, slider),
            linkVisualShapeIndices=(speck,) * 3,
            linkPositions=(
                (0, body.axle / 2, body.wheel_radius),
                (0, -body.axle / 2, body.wheel_radius),
                (0, 0, 0.0041),  # 0.1 mm above the floor: more makes the horizon jump
            ),
            linkOrientations=(still,) * 3,
            linkInertialFramePositions=((0, 0, 0),) * 3,
            linkInertialFrameOrientations=(still,) * 3,
            linkParentIndices=(0,) * 3,
            linkJointTypes=(b.JOINT_REVOLUTE, b.JOINT_REVOLUTE, b.JOINT_FIXED),
            linkJointAxis=((0, 1, 0),) * 3,
            **c,
        )  # fmt: skip
        for link, grip in ((self.LEFT, self.GRIP), (self.RIGHT, self.GRIP), (self.SLIDER, 0.0)):
            b.changeDynamics(robot, link, lateralFriction=grip, **c)
        return robot

    def _joints(self) -> np.ndarray:
        states = self.bullet.getJointStates(self.robot, (self.LEFT, self.RIGHT), **self.client)
        return np.array([state[0] for state in states])

    @property
    def wheels(self) -> np.ndarray:
        """rad, both wheels since the start, left first."""
        return self._joints() - self._angles

    def reset(self) -> None:
        self.bullet.restoreState(self._start, **self.client)

    def step(self, speeds: np.ndarray) -> None:
        b = self.bullet
        b.setJointMotorControlArray(
            self.robot, (self.LEFT, self.RIGHT), b.VELOCITY_CONTROL,
            targetVelocities=speeds.tolist(), forces=(self.TORQUE,) * 2, **self.client,
        )  # fmt: skip
        for _ in range(self.substeps):
            b.stepSimulation(**self.client)

    def pose(self) -> Pose:
        center, quaternion = self.bullet.getBasePositionAndOrientation(self.robot, **self.client)
        rotation = np.array(self.bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        return Pose(np.array(center) - rotation @ self.CENTER_OF_MASS, rotation)

    def snapshot(self) -> bytes:
        """PyBullet's own file, contacts included: only so does a restored run go on exactly."""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "world.bullet")
            self.bullet.saveBullet(path, **self.client)
            with open(path, "rb") as file:
                return file.read()

    def restore(self, snapshot: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "world.bullet")
            with open(path, "wb") as file:
                file.write(snapshot)
            self.bullet.restoreState(fileName=path, **self.client)

"""The world around the robot: a gray floor, a ring of coloured blocks, light, a camera."""

import math
import os
import sys
import weakref
from types import ModuleType

import numpy as np

from dntorch.envs.layout import SHAPES, Light, Ring
from dntorch.process import occupy_streams

FLOOR_GRAY = (0.5, 0.5, 0.5, 1.0)


def load_pybullet() -> ModuleType:
    """Import PyBullet without its banner, which C code writes to standard error."""
    if sys.modules.get("pybullet"):
        return sys.modules["pybullet"]
    occupy_streams()  # it may print at any time
    saved, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 2)
        import pybullet
    except ImportError as error:
        raise ImportError(
            "the simulated e-puck needs PyBullet (Python 3.10 or 3.11): "
            "run pip install 'dntorch[sim]'"
        ) from error
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(null)
    return pybullet


def drum(radius: float, height: float, sides: int = 24) -> dict[str, list]:
    """A cylinder around z as a mesh: a side and two flat ends."""
    turn = np.arange(sides) * (2 * math.pi / sides)
    out = np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=1)
    up = np.tile((0.0, 0.0, 1.0), (sides, 1))
    low, high = radius * out - height / 2 * up, radius * out + height / 2 * up
    here, next_ = np.arange(sides), (np.arange(sides) + 1) % sides
    # The rims appear twice, with the normal of the side and with that of the end.
    side = [(here, next_, next_ + sides), (here, next_ + sides, here + sides)]
    ends = [(0 * here, next_, here), (0 * here + sides, here + sides, next_ + sides)]
    ends = [tuple(corner + 2 * sides for corner in face) for face in ends]
    return {
        "vertices": np.concatenate((low, high, low, high)).tolist(),
        "normals": np.concatenate((out, out, -up, up)).tolist(),
        "indices": np.concatenate([np.stack(f, axis=1) for f in side + ends]).ravel().tolist(),
    }


class Scene:
    """A PyBullet world of its own, drawn by the software renderer (no display, no GPU).

    Args:
        ring: where the blocks stand.
        light: how they are lit.

    Raises:
        ImportError: PyBullet is not installed.
    """

    def __init__(self, ring: Ring, light: Light) -> None:
        self.bullet = load_pybullet()
        self.client = {"physicsClientId": self.bullet.connect(self.bullet.DIRECT)}
        # Once, at the latest when nobody holds the scene: a second disconnect would raise.
        self._disconnect = weakref.finalize(self, self.bullet.disconnect, **self.client)
        self.light = light
        floor = self.shape("box", (3.0, 3.0, 0.1), FLOOR_GRAY)
        self.place(floor, (0, 0, -0.05))
        self.blocks = [
            self._block(ring, k, angle, center)
            for k, (angle, center) in enumerate(zip(ring.angles, ring.centers, strict=True))
        ]

    def _block(self, ring: Ring, k: int, angle: float, center: np.ndarray) -> int:
        size = ring.block_size
        kind = SHAPES[k % 3] if ring.block_shape == "mixed" else ring.block_shape
        facing = self.bullet.getQuaternionFromEuler((0, 0, angle))
        shape = self.shape(kind, (size, size, size), FLOOR_GRAY)
        return self.place(shape, (*center, size / 2), facing)

    def shape(self, kind: str, size: tuple[float, float, float], color) -> dict[str, int]:
        """Collision and visual shape ids; ``size`` in metres along x, y, z."""
        b, half = self.bullet, [part / 2 for part in size]
        # PyBullet reads what the kind needs; its renderer would draw a cylinder as a capsule.
        kinds = {"box": b.GEOM_BOX, "cylinder": b.GEOM_CYLINDER, "sphere": b.GEOM_SPHERE}
        solid = {"shapeType": kinds[kind], "radius": half[0], "halfExtents": half}
        drawn = solid
        if kind == "cylinder":
            drawn = {"shapeType": b.GEOM_MESH, **drum(half[0], size[2])}
        return {
            "baseCollisionShapeIndex": b.createCollisionShape(
                **solid, height=size[2], **self.client
            ),
            # Without specular light a painted colour is one hue from every side.
            "baseVisualShapeIndex": b.createVisualShape(
                **drawn, rgbaColor=color, specularColor=(0, 0, 0), **self.client
            ),
        }

    def place(self, shape: dict[str, int], position, orientation=(0, 0, 0, 1)) -> int:
        """A body that does not move; its id."""
        return self.bullet.createMultiBody(
            0, basePosition=position, baseOrientation=orientation, **shape, **self.client
        )

    def move(self, body: int, position: np.ndarray, yaw: float) -> None:
        """Put a body elsewhere: metres, radians."""
        turned = self.bullet.getQuaternionFromEuler((0, 0, yaw))
        self.bullet.resetBasePositionAndOrientation(body, position, turned, **self.client)

    def paint(self, colors: np.ndarray) -> None:
        """Give every block its colour: ``(blocks, 3)``, red, green, blue from 0 to 1."""
        for block, color in zip(self.blocks, colors, strict=True):
            self.bullet.changeVisualShape(block, -1, rgbaColor=(*color, 1), **self.client)

    def photograph(self, eye, target, up, size: tuple[int, int], fov: float, near: float):
        """A picture from ``eye`` (m) towards ``target``: uint8 ``(height, width, 3)``, RGB.

        ``size`` is (width, height) in pixels, ``fov`` the horizontal angle in radians.
        """
        b, (width, height), lamp = self.bullet, size, self.light
        right = math.tan(fov / 2) * near
        top = right * height / width
        picture = b.getCameraImage(
            width, height,
            b.computeViewMatrix(eye, target, up, **self.client),
            b.computeProjectionMatrix(-right, right, -top, top, near, 4.0, **self.client),
            # The light is sticky from call to call: say all of it every time.
            lightDirection=lamp.direction, lightColor=lamp.color, lightDistance=2.0,
            lightAmbientCoeff=lamp.ambient, lightDiffuseCoeff=lamp.diffuse,
            lightSpecularCoeff=lamp.specular, shadow=int(lamp.shadow),
            flags=b.ER_NO_SEGMENTATION_MASK, renderer=b.ER_TINY_RENDERER, **self.client,
        )[2]  # fmt: skip
        return np.asarray(picture, np.uint8).reshape(height, width, 4)[:, :, :3].copy()

    def distances(self, starts: np.ndarray, directions: np.ndarray, reach: float) -> np.ndarray:
        """How far each ray runs before it hits something, at most ``reach``; metres."""
        ends = starts + reach * directions
        hits = self.bullet.rayTestBatch(starts.tolist(), ends.tolist(), numThreads=1, **self.client)
        return reach * np.array([hit[2] for hit in hits])

    def close(self) -> None:
        """Give the client back; a second call does nothing."""
        self._disconnect()

    @property
    def closed(self) -> bool:
        return not self._disconnect.alive

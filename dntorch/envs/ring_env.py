"""The e-puck in its ring of blocks as a Gymnasium environment that needs no simulator."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from dntorch.envs.blocks import BlocksEnv
from dntorch.envs.drive import Pin
from dntorch.envs.layout import Ring
from dntorch.envs.pose import Pose
from dntorch.envs.ring_camera import RingCamera
from dntorch.envs.ring_view import RingView
from dntorch.envs.task import SequenceTask


class RingEnv(BlocksEnv):
    """The ring of blocks seen by casting rays in torch: without PyBullet, on any system.

    Actions, observations and infos are those of `BlocksEnv`. The robot turns without slip on
    a pin, as that of ``EPuckEnv(pivot="kinematic")``, whose images it sees. Boxes or cylinders,
    no shadows; the view from outside is drawn from above. For many robots at once take
    `RingWorld`.

    Args:
        task, ring, others: as of `BlocksEnv`.

    Raises:
        ValueError: an argument that makes no world; the sentence says what to give.
    """

    def __init__(
        self, task: SequenceTask | None = None, ring: Ring | None = None, **others: Any
    ) -> None:
        super().__init__(task, ring, **others)
        self._drive = Pin(self.body, self.dt)
        colors, exact = self.task.colors, torch.float64
        self._camera = RingCamera(self.ring, self.light, self.body, colors, exact)
        self._outside = RingView(self.ring, self.body)

    def _see(self) -> np.ndarray:
        with torch.no_grad():
            walls = self._camera.walls(*_tensors(self._pose))
            image = self._camera.image(walls, torch.from_numpy(self.layout))
        return np.ascontiguousarray(image)

    def _feel(self) -> np.ndarray:
        with torch.no_grad():
            reading = self._camera.proximity(*_tensors(self._pose))
        return reading.numpy().astype(np.float32)

    def _draw(self, pose: Pose) -> np.ndarray:
        return self._outside.view(pose, self._paints[self.layout])


def _tensors(pose: Pose) -> tuple[Tensor, Tensor, Tensor]:
    x, y, _ = pose.position
    return tuple(torch.tensor(part, dtype=torch.float64) for part in (x, y, pose.yaw))

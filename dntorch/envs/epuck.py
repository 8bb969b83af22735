"""The world of the paper as a Gymnasium environment: an e-puck in PyBullet."""

from typing import Any

import numpy as np

from dntorch.envs import sensors
from dntorch.envs.blocks import BlocksEnv
from dntorch.envs.drive import Free, Pin
from dntorch.envs.layout import Ring
from dntorch.envs.pose import Pose
from dntorch.envs.scene import Scene
from dntorch.envs.spectator import Spectator
from dntorch.envs.task import SequenceTask
from dntorch.quantities import check_quantities

PIVOTS = ("free", "kinematic")


class EPuckEnv(BlocksEnv):
    """The ring of blocks in PyBullet, drawn by its software renderer.

    Actions, observations and infos are those of `BlocksEnv`; blocks of any shape.

    Args:
        task, ring, others: as of `BlocksEnv`.
        substeps: physics steps in one control step.
        pivot: ``free`` on PyBullet's floor, or ``kinematic``, turning exactly on a pin.

    Raises:
        ValueError: an argument that makes no world; the sentence says what to give.
        ImportError: PyBullet is not installed.
    """

    def __init__(
        self,
        task: SequenceTask | None = None,
        ring: Ring | None = None,
        *,
        substeps: int = 4,
        pivot: str = "free",
        **others: Any,
    ) -> None:
        check_quantities(substeps=substeps)
        if substeps != int(substeps):
            raise ValueError(f"substeps={substeps!r}: give a whole number")
        if pivot not in PIVOTS:
            raise ValueError(f"pivot={pivot!r}: choose from {PIVOTS}")
        super().__init__(task, ring, **others)
        self._world |= {"substeps": substeps, "pivot": pivot}
        self.pivot, self._spectator = pivot, None
        self._scene = Scene(self.ring, self.light)
        free = pivot == "free"
        self._drive = (
            Free(self._scene, self.body, self.dt, substeps) if free else Pin(self.body, self.dt)
        )

    def _see(self) -> np.ndarray:
        return sensors.image(self._scene, self.body, self._pose)

    def _feel(self) -> np.ndarray:
        return sensors.proximity(self._scene, self._pose)

    def _draw(self, pose: Pose) -> np.ndarray:
        if self._spectator is None:
            self._spectator = Spectator(self.ring, self.light, self.body)
        return self._spectator.view(pose, self._paints[self.layout])

    def _arrange(self, layout: np.ndarray) -> None:
        super()._arrange(layout)
        self._scene.paint(self._paints[layout])

    def close(self) -> None:
        """Give both PyBullet clients back; a second call does nothing."""
        super().close()
        self._scene.close()
        if self._spectator is not None:
            self._spectator.close()

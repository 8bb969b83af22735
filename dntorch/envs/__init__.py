"""Worlds in which colours are found: the task, and the e-puck in its ring of blocks.

The task, the abstract world and the ring in torch need PyTorch alone (layouts are drawn with
NumPy); the e-puck in PyBullet needs Gymnasium too: ``pip install 'dntorch[sim]'``. Each name is
imported when it is first asked for. ``dntorch/EPuck-v0`` and ``dntorch/Ring-v0`` are registered
where Gymnasium is installed.
"""

from typing import TYPE_CHECKING

from dntorch.envs.registration import register, register_in_time
from dntorch.lazy import later

if TYPE_CHECKING:
    from dntorch.envs.adaptor import GymWorld
    from dntorch.envs.epuck import EPuckEnv
    from dntorch.envs.hardware import HardwareEnv
    from dntorch.envs.judge import Judge
    from dntorch.envs.layout import Light, Ring
    from dntorch.envs.nodes import NodesState, NodesWorld
    from dntorch.envs.ring import RingState, RingWorld
    from dntorch.envs.ring_env import RingEnv
    from dntorch.envs.task import NOTHING, SequenceTask, TaskState
    from dntorch.envs.world import Outcome, World
else:  # the same, later
    __getattr__, __dir__ = later(
        __name__,
        {
            "EPuckEnv": "epuck",
            "GymWorld": "adaptor",
            "HardwareEnv": "hardware",
            "Judge": "judge",
            "Light": "layout",
            "NOTHING": "task",
            "NodesState": "nodes",
            "NodesWorld": "nodes",
            "Outcome": "world",
            "Ring": "layout",
            "RingEnv": "ring_env",
            "RingState": "ring",
            "RingWorld": "ring",
            "SequenceTask": "task",
            "TaskState": "task",
            "World": "world",
        },
    )

__all__ = [
    "NOTHING",
    "EPuckEnv",
    "GymWorld",
    "HardwareEnv",
    "Judge",
    "Light",
    "NodesState",
    "NodesWorld",
    "Outcome",
    "Ring",
    "RingEnv",
    "RingState",
    "RingWorld",
    "SequenceTask",
    "TaskState",
    "World",
    "register",
]

register_in_time()

"""Worlds in which colours are found: the task, and the e-puck in its ring of blocks.

The task and the abstract world need PyTorch alone; the e-puck needs Gymnasium and PyBullet, which
``pip install 'dntorch[sim]'`` brings. Each name is imported when it is first asked for.
``dntorch/EPuck-v0`` is registered where Gymnasium is installed.
"""

from typing import TYPE_CHECKING

from dntorch.envs.registration import register, register_in_time
from dntorch.lazy import later

if TYPE_CHECKING:
    from dntorch.envs.epuck import EPuckEnv
    from dntorch.envs.hardware import HardwareEnv
    from dntorch.envs.judge import Judge
    from dntorch.envs.layout import Light, Ring
    from dntorch.envs.nodes import NodesState, NodesStep, NodesWorld
    from dntorch.envs.task import NOTHING, SequenceTask, TaskState
else:  # the same, later
    __getattr__, __dir__ = later(
        __name__,
        {
            "EPuckEnv": "epuck",
            "HardwareEnv": "hardware",
            "Judge": "judge",
            "Light": "layout",
            "NOTHING": "task",
            "NodesState": "nodes",
            "NodesStep": "nodes",
            "NodesWorld": "nodes",
            "Ring": "layout",
            "SequenceTask": "task",
            "TaskState": "task",
        },
    )

__all__ = [
    "NOTHING",
    "EPuckEnv",
    "HardwareEnv",
    "Judge",
    "Light",
    "NodesState",
    "NodesStep",
    "NodesWorld",
    "Ring",
    "SequenceTask",
    "TaskState",
    "register",
]

register_in_time()

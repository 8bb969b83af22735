"""Worlds in which colours are found: the task, and the e-puck in its ring of blocks.

The task and the abstract world need PyTorch alone; the e-puck needs Gymnasium and PyBullet, which
``pip install 'dntorch[sim]'`` brings. Importing this package registers
``dntorch/EPuck-v0`` where Gymnasium is installed.
"""

from importlib import import_module
from importlib.util import find_spec

from dntorch.envs.nodes import NodesState, NodesWorld
from dntorch.envs.task import NOTHING, SequenceTask, TaskState
from dntorch.envs.world import Outcome, World

#: What needs NumPy, Gymnasium or PyBullet is imported when it is first asked for.
_LATER = {
    "EPuckEnv": "epuck", "HardwareEnv": "hardware", "Judge": "judge", "Light": "layout",
    "Ring": "layout",
}  # fmt: skip

__all__ = [
    "NOTHING", "NodesState", "NodesWorld", "Outcome", "SequenceTask", "TaskState", "World",
    "register", *_LATER,
]  # fmt: skip


def register() -> None:
    """Make ``dntorch/EPuck-v0`` known to ``gymnasium.make``; harmless twice."""
    if find_spec("gymnasium") is None:
        return
    import gymnasium

    if "dntorch/EPuck-v0" not in gymnasium.registry:
        gymnasium.register("dntorch/EPuck-v0", entry_point="dntorch.envs.epuck:EPuckEnv")


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"dntorch.envs.{_LATER[name]}"), name)


register()

"""Worlds in which colours are found: the task, and the e-puck in its ring of blocks.

The task, the abstract world and the ring in torch need PyTorch alone (layouts are drawn with
NumPy); the e-puck in PyBullet needs Gymnasium too: ``pip install 'dntorch[sim]'``.
Importing this package registers ``dntorch/EPuck-v0`` and ``dntorch/Ring-v0`` where Gymnasium is
installed.
"""

from importlib import import_module
from importlib.util import find_spec

from dntorch.envs.judge import Judge
from dntorch.envs.layout import Light, Ring
from dntorch.envs.nodes import NodesState, NodesStep, NodesWorld
from dntorch.envs.ring import RingState, RingWorld
from dntorch.envs.task import NOTHING, SequenceTask, TaskState
from dntorch.envs.world import Outcome, PureWorld

#: What needs NumPy, Gymnasium or PyBullet is imported when it is first asked for.
_LATER = {"EPuckEnv": "epuck", "HardwareEnv": "hardware", "RingEnv": "ring_env"}

__all__ = [
    "NOTHING",
    "Judge",
    "Light",
    "NodesState",
    "NodesStep",
    "NodesWorld",
    "Outcome",
    "PureWorld",
    "Ring",
    "RingState",
    "RingWorld",
    "SequenceTask",
    "TaskState",
    "register",
    *_LATER,
]


def register() -> None:
    """Make the envs known to ``gymnasium.make``; harmless twice."""
    if find_spec("gymnasium") is None:
        return
    import gymnasium

    for name, place in (("EPuck", "epuck:EPuckEnv"), ("Ring", "ring_env:RingEnv")):
        if f"dntorch/{name}-v0" not in gymnasium.registry:
            gymnasium.register(f"dntorch/{name}-v0", entry_point=f"dntorch.envs.{place}")


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"dntorch.envs.{_LATER[name]}"), name)


register()

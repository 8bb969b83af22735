"""An agent's state as buffers, as a flat dict of tensors, and as bytes."""

from collections.abc import Mapping
from operator import is_
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.dynamics import Dynamics
from dntorch.experiments import checkpoint
from dntorch.modules.sarsa import AgentState, DNSarsa


class StateBuffers:
    """The state of an agent where it lies, in buffers, and as tensors by name.

    Attributes:
        names: of the tensors, such as ``learner.trace.u``.
    """

    def __init__(self, agent: DNSarsa) -> None:
        self.agent = agent
        leaves, self._structure = pytree.tree_flatten_with_path(agent.state)
        paths = [pytree.keystr(path) for path, _ in leaves]
        self.names = [path.replace("['", ".").replace("']", "").lstrip(".") for path in paths]
        self._holders = [_holder(agent, name) for name in self.names]
        self._view: tuple[list[Tensor], AgentState] | None = None

    def __reduce__(self) -> tuple:
        # PyTorch warns of its own when it unpickles a structure.
        return StateBuffers, (self.agent,)

    def read(self) -> AgentState:
        """The state as it lies there: a step reads it and writes none, so no copies."""
        held = self._held()
        if self._view is None or not all(map(is_, held, self._view[0])):
            self._view = held, pytree.tree_unflatten(held, self._structure)
        return self._view[1]

    def write(self, state: AgentState) -> None:
        for buffer, value in zip(self._held(), _leaves(state)):
            buffer.copy_(value.detach())

    def flat(self, state: AgentState) -> dict[str, Tensor]:
        """Tensors by name."""
        return dict(zip(self.names, _leaves(state)))

    def nested(self, tensors: Mapping[str, Tensor]) -> AgentState:
        """The state that has these tensors."""
        return pytree.tree_unflatten([tensors[name] for name in self.names], self._structure)

    def _held(self) -> list[Tensor]:
        # By dict and key: a resize or a move to another device puts others in their place.
        return [buffers[name] for buffers, name in self._holders]


def _leaves(state: Any) -> list[Tensor]:
    """The tensors of a nested state in order, several times faster than any general tree."""
    if isinstance(state, Tensor):
        return [state]
    parts = state.values() if isinstance(state, dict) else state
    return [leaf for part in parts for leaf in _leaves(part)]


def _holder(agent: DNSarsa, name: str) -> tuple[dict[str, Tensor], str]:
    """The buffers of the structure that holds one field of the agent's state, and its key."""
    path, _, attribute = name.rpartition(".")
    part = agent.get_submodule(path)
    inner = getattr(part, attribute)
    return (inner._buffers, "u") if isinstance(inner, Dynamics) else (part._buffers, attribute)


def pack(content: dict[str, Any]) -> dict[str, Tensor]:
    """A checkpoint as bytes: collectors send nothing between processes but dicts of tensors."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        checkpoint.save(path, content)
        return {"bytes": torch.frombuffer(bytearray(path.read_bytes()), dtype=torch.uint8)}


def unpack(packed: dict[str, Tensor]) -> dict[str, Any]:
    """The content of `pack`, without running any code that it might bring."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        path.write_bytes(packed["bytes"].numpy().tobytes())
        return checkpoint.load(path)

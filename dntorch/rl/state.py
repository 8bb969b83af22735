"""An agent's state as buffers, and as bytes."""

from operator import is_
from typing import Any

import torch
from torch import Tensor

from dntorch import files
from dntorch.modules.sarsa import AgentState, DNSarsa


class StateBuffers:
    """The state of an agent in its buffers, read without the copies that ``agent.state`` makes.

    Attributes:
        names: of the tensors, such as ``learner.trace.u``.
    """

    def __init__(self, agent: DNSarsa) -> None:
        self.agent = agent
        self.names = list(agent.flat(agent.state))
        paths = [name.rpartition(".") for name in self.names]
        self._holders = [(agent.get_submodule(path)._buffers, key) for path, _, key in paths]
        self._view: tuple[list[Tensor], AgentState] | None = None

    def __reduce__(self) -> tuple:
        return StateBuffers, (self.agent,)  # a copied agent has other buffers

    def read(self) -> AgentState:
        """The state as it lies there: a step reads it and writes none, so no copies."""
        held = self._held()
        if self._view is None or not all(map(is_, held, self._view[0])):
            self._view = held, self.agent.nested(dict(zip(self.names, held)))
        return self._view[1]

    def write(self, state: AgentState) -> None:
        for buffer, value in zip(self._held(), self.agent.flat(state).values()):
            buffer.copy_(value.detach())

    def _held(self) -> list[Tensor]:
        # By dict and key: a resize or a move to another device puts others in their place.
        return [buffers[key] for buffers, key in self._holders]


def pack(content: dict[str, Any]) -> dict[str, Tensor]:
    """A checkpoint as bytes: collectors send nothing between processes but dicts of tensors.

    Raises:
        ValueError: something in it could not be loaded again; the sentence says where.
    """
    return {"bytes": torch.frombuffer(bytearray(files.to_bytes(content)), dtype=torch.uint8)}


def unpack(packed: dict[str, Tensor]) -> dict[str, Any]:
    """The content of `pack`, without running any code that it might bring."""
    return files.from_bytes(packed["bytes"].numpy().tobytes())

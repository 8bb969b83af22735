"""An agent's state in its buffers."""

from operator import is_
from typing import Any

from torch import Tensor, nn

from dntorch.modules.sarsa import AgentState


class StateBuffers:
    """The state of a policy's agent in its buffers, read without the copies of ``agent.state``.

    The agent, its parts and their buffers are those of the moment: what was replaced is found.

    Args:
        policy: a module with an ``agent`` and ``require_form(agent)``, which refuses an agent
            that was changed so that it no longer fits.
    """

    def __init__(self, policy: Any) -> None:
        self.policy = policy
        self._places: tuple[list[dict], list[str], list[nn.Module]] = [], [], []
        self._holders: list[tuple[dict, str]] = []
        self._names: list[str] = []
        self._view: tuple[list[Tensor], AgentState] | None = None

    def __reduce__(self) -> tuple:
        return StateBuffers, (self.policy,)  # a copied policy has other buffers

    @property
    def names(self) -> list[str]:
        """Of the tensors, such as ``learner.trace.u``."""
        self._find()
        return self._names

    def read(self) -> AgentState:
        """The state as it lies there: a step reads it and writes none, so no copies."""
        self._find()
        held = self._held()
        if self._view is None or not all(map(is_, held, self._view[0])):
            self.policy.require_form(self.policy.agent)
            self._view = held, self.policy.agent.nested(dict(zip(self._names, held)))
        return self._view[1]

    def write(self, state: AgentState) -> None:
        for buffer, value in zip(self._held(), self.policy.agent.flat(state).values()):
            buffer.copy_(value.detach())

    def _held(self) -> list[Tensor]:
        # By dict and key: a resize or a move to another device puts others in their place.
        return [buffers[key] for buffers, key in self._holders]

    def _find(self) -> None:
        """Look up where the buffers lie, if the agent or one of its parts is another."""
        owners, keys, parts = self._places
        if parts and all(map(is_, map(dict.get, owners, keys), parts)):
            return
        agent = self.policy.agent
        if parts:
            self.policy.require_form(agent, replaced=True)
        self._names, self._view = list(agent.flat(agent.state)), None
        paths = [name.rpartition(".") for name in self._names]
        self._holders = [(agent.get_submodule(path)._buffers, key) for path, _, key in paths]
        chains = {f"agent.{path}".rstrip(".") for path, _, _ in paths}
        whole = {chain[:end] for chain in chains for end in _ends(chain)}
        places = [path.rpartition(".") for path in sorted(whole)]
        owners = [self.policy.get_submodule(path)._modules for path, _, _ in places]
        keys = [key for _, _, key in places]
        self._places = owners, keys, [owner[key] for owner, key in zip(owners, keys)]


def _ends(path: str) -> list[int]:
    """Where each module on a dotted path ends."""
    return [k for k, letter in enumerate(path) if letter == "."] + [len(path)]

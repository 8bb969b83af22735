"""The library's ways to take a portion of core steps: eager, compiled, a loop in one graph."""

import numpy as np
import torch
from torch import Tensor
from torch._higher_order_ops.while_loop import while_loop
from torch.utils._pytree import tree_flatten, tree_map, tree_unflatten

from dntorch import DNSarsa


def innermost(tensor: Tensor, batch_dim: int = 0) -> Tensor:
    """The same tensor with its batch innermost in memory."""
    if tensor.shape[batch_dim] == 1:
        return tensor.clone(memory_format=torch.contiguous_format)
    last = tensor.movedim(batch_dim, -1)
    return last.clone(memory_format=torch.contiguous_format).movedim(-1, batch_dim)


class Modules:
    """The library, one call per step."""

    compiled = False

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        _, batch, n = match.shape
        self.agent = DNSarsa(n).spread(batch)
        self.state = tree_map(innermost, self.agent.initial([batch]))
        self.noise = innermost(torch.zeros(batch, n))
        self.match, self.reward = innermost(torch.from_numpy(match), 1), torch.from_numpy(reward)
        self.advance = self.step
        if self.compiled:
            self.advance = torch.compile(self.step, fullgraph=True, dynamic=False)

    def step(self, match: Tensor, reward: Tensor, state: tuple) -> tuple:
        return self.agent.step({"match": match}, reward, self.noise, state)[1]

    @torch.no_grad()
    def __call__(self) -> None:
        for match, reward in zip(self.match.unbind(), self.reward.unbind()):
            self.state = self.advance(match, reward, self.state)

    @property
    def weights(self) -> np.ndarray:
        return self.state.learner.values.weights.numpy()


class Compiled(Modules):
    compiled = True


class Rollout(Modules):
    """All steps of a portion in one graph: a loop that the compiler sees, and writes in C++."""

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        super().__init__(match, reward)
        options = {"cpp_wrapper": True}  # a third of the time where the batch is small
        self.rollout = torch.compile(self.all_steps, fullgraph=True, dynamic=False, options=options)

    def all_steps(self, match: Tensor, reward: Tensor, state: tuple) -> tuple:
        leaves, form = tree_flatten(state)
        steps = match.shape[0]

        def more(now: Tensor, *leaves: Tensor) -> Tensor:
            return now < steps

        def advance(now: Tensor, *leaves: Tensor) -> tuple[Tensor, ...]:
            t = now.item()
            torch._check(t >= 0)
            torch._check(t < steps)
            ahead = self.step(match.select(0, t), reward.select(0, t), tree_unflatten(leaves, form))
            return now + 1, *(x.clone() for x in tree_flatten(ahead)[0])

        last = while_loop(more, advance, (torch.zeros((), dtype=torch.int64), *leaves))
        return tree_unflatten(last[1:], form)

    @torch.no_grad()
    def __call__(self) -> None:
        self.state = self.rollout(self.match, self.reward, self.state)

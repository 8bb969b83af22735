"""Tasks and worlds that are drawn, one for each agent."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from dntorch.envs.task import SequenceTask


class DrawnTask(SequenceTask):
    """A rewarded sequence of each agent's own; all else is as in ``task``.

    Args:
        task: gives reward, colours and the length of a sequence.
        targets: positions of the colours of each sequence, int64, ``(batch, length)``.
        n: number of behaviours; more than there are colours is for a world that shows none.
    """

    def __init__(self, task: SequenceTask, targets: Tensor, n: int) -> None:
        super().__init__(task.sequence, task.colors, task.reward, task.duration, task.dt)
        self.targets = targets.unsqueeze(-2)
        self.colors = "".join(chr(ord("a") + k) for k in range(n))


def draw_targets(
    seed: int, agents: Sequence[int], n: int, length: int, feasible: Tensor | None = None
) -> Tensor:
    """Sequences drawn from all, or from all that are ``feasible``, int64 ``(agents, length)``.

    The first behaviour is uniform, each next one uniform among those that may follow.

    >>> draw_targets(0, [3, 4], n=4, length=5).shape
    torch.Size([2, 5])
    """
    anything = 1 - np.eye(n)
    drawn = []
    for k, agent in enumerate(agents):
        random = np.random.default_rng([seed, agent, 0])
        open_ = anything if feasible is None else feasible[k].numpy()
        sequence = [int(random.integers(n))]
        while len(sequence) < length:
            sequence.append(int(random.choice(np.flatnonzero(open_[:, sequence[-1]]))))
        drawn.append(sequence)
    return torch.tensor(drawn)


def draw_feasible(seed: int, agents: Sequence[int], n: int, after: int) -> Tensor:
    """Tables ``[behaviour, found last]``: each behaviour is possible after ``after`` others.

    The union of as many random rounds through all behaviours, so that none is a dead end. Bool,
    ``(agents, n, n)``.

    >>> draw_feasible(0, [0], n=5, after=2).sum(-1).tolist()
    [[2, 2, 2, 2, 2]]
    """
    tables = torch.zeros(len(agents), n, n, dtype=torch.bool)
    for table, agent in zip(tables, agents):
        random = np.random.default_rng([seed, agent, 1])
        rounds = 0
        while rounds < after:
            order = torch.from_numpy(random.permutation(n))
            if not table[order, order.roll(1)].any():
                table[order, order.roll(1)] = True
                rounds += 1
    return tables

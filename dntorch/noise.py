"""Random numbers that depend on what they are for, not on when they are drawn.

A counter-based generator (Philox4x32-10: Salmon, Moraes, Dror and Shaw, "Parallel random
numbers: as easy as 1, 2, 3", 2011) maps (seed, agent, occasion, purpose) to numbers. So a
draw is the same alone and inside a batch, in float32 and float64, on another device, in an
exported program and after a resume; there is no generator state to save.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.checks import check_count
from dntorch.number import Number, span

MASK = 0xFFFFFFFF
MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
WEYL = (0x9E3779B9, 0xBB67AE85)


def philox(counter: list[Tensor], key: list[Tensor]) -> list[Tensor]:
    """Four random 32-bit words (in int64) from four counter words and two key words."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(10):
        product0, product1 = MULTIPLIERS[0] * c0, MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (
            ((product1 >> 32) & MASK) ^ c1 ^ k0,
            product1 & MASK,
            ((product0 >> 32) & MASK) ^ c3 ^ k1,
            product0 & MASK,
        )
        k0, k1 = (k0 + WEYL[0]) & MASK, (k1 + WEYL[1]) & MASK
    return [c0, c1, c2, c3]


def keyed_uniform(
    seed: int | Tensor, agent: Tensor, occasion: Tensor, count: int, stream: int
) -> Tensor:
    """``count`` numbers in [0, 1), float64, ``(*batch, count)``, for each agent and occasion.

    Args:
        seed: of the experiment, 0 to 2**32 - 1, or one of each agent's, int64, ``(*batch,)``.
        agent: number of each agent, int64, ``(*batch,)``.
        occasion: number of its decision (or visit, …), int64, ``(*batch,)``.
        count: numbers per draw.
        stream: what they are for; draws for different purposes are independent.

    >>> alone = keyed_uniform(7, torch.tensor([3]), torch.tensor([5]), 2, 0)
    >>> batch = keyed_uniform(7, torch.arange(10), torch.full((10,), 5), 2, 0)
    >>> bool((batch[3] == alone[0]).all())
    True
    """
    blocks = torch.arange((count + 3) // 4, device=agent.device)
    zero = torch.zeros_like(agent.unsqueeze(-1) + blocks)
    counter = [zero + blocks, zero + occasion.unsqueeze(-1), zero + agent.unsqueeze(-1), zero]
    if isinstance(seed, Tensor):
        seed = seed.to(zero).unsqueeze(-1)
    words = torch.stack(philox(counter, [zero + seed, zero + stream]), -1)
    return words.flatten(-2)[..., :count].to(torch.float64) / 2**32


class Exploration:
    """Noise on the values of actions, drawn anew at each decision: random behaviours.

    Uniform between 0 and ``amplitude``, which is large against learned values, so that
    while it lasts every behaviour but the last one is equally likely to be chosen.
    No noise, zeros, is exploitation.

    A number that is drawn depends on seed, agent and decision alone, whenever it is asked for.
    ``seed`` and ``amplitude`` may be set at any time, and what a call returns may be edited.

    Args:
        n: number of behaviours.
        seed: of the experiment, 0 to 2**32 - 1; a tensor ``(*batch,)`` for one per agent.
        agents: number of each agent, an int (no batch) or a sequence of them.
        amplitude: largest noise; the largest learned value is about the reward's area. A tensor
            ``(*batch,)`` for one per agent.

    Raises:
        ValueError: a seed or a number of an agent out of range, an amplitude that is not positive
            and finite.
    """

    STREAM = 1

    def __init__(
        self,
        n: int,
        seed: int | Tensor,
        agents: int | Sequence[int] | Tensor = 0,
        amplitude: Number = 10.0,
    ) -> None:
        check_count("n", n)
        self.n, self.agents = n, agents
        self.seed, self.amplitude = seed, amplitude

    def __setattr__(self, name: str, value: object) -> None:
        if name == "agents":
            value = torch.as_tensor(list(value) if isinstance(value, range) else value).clone()
            if value.is_floating_point() or not bool(((value >= 0) & (value <= MASK)).all()):
                raise ValueError(f"agents={value.tolist()}: give whole numbers from 0 to {MASK}")
        super().__setattr__(name, value)
        if name != "_drawn":
            self._drawn = None  # what was drawn was for other settings

    @property
    def seed(self) -> int | Tensor:
        return self._seed

    @seed.setter
    def seed(self, seed: int | Tensor) -> None:
        whole = isinstance(seed, (int, Tensor)) and not isinstance(seed, bool)
        numbers = torch.as_tensor(seed if whole else 0.5)
        if numbers.is_floating_point() or not bool(((numbers >= 0) & (numbers <= MASK)).all()):
            raise ValueError(f"seed={seed}: give a whole number from 0 to {MASK}")
        self._seed = seed.clone() if isinstance(seed, Tensor) else seed

    @property
    def amplitude(self) -> Number:
        return self._amplitude

    @amplitude.setter
    def amplitude(self, amplitude: Number) -> None:
        if not isinstance(amplitude, (int, float, Tensor)):
            raise ValueError(f"amplitude={amplitude!r} is no number: give a float")
        low, high = span(amplitude)
        if not 0 < low <= high < math.inf:
            raise ValueError(f"amplitude={amplitude} must be positive: for none, pass zeros")
        self._amplitude = amplitude

    def __call__(self, decisions: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
        """Noise ``(*batch, n)`` for the number of decisions each agent has taken.

        Raises:
            ValueError: decisions of another batch than that of the agents.
        """
        if decisions.shape != self.agents.shape:
            raise ValueError(
                f"decisions of shape {list(decisions.shape)} do not fit the agents of shape "
                f"{list(self.agents.shape)}: number each agent, as Exploration(n, seed, "
                "agents=range(batch))"
            )
        if self._drawn is None or not torch.equal(self._drawn[0], decisions):
            agents = self.agents.to(decisions.device)
            draws = keyed_uniform(self.seed, agents, decisions, self.n, self.STREAM)
            self._drawn = decisions.clone(), draws
        return self._sized(self._drawn[1], dtype)

    def ahead(self, decisions: Tensor, rows: int, dtype: torch.dtype = torch.float32) -> Tensor:
        """Noise of the next ``rows`` decisions of each agent, ``(*batch, rows, n)``."""
        agents = self.agents.to(decisions.device)
        later = torch.arange(rows, device=decisions.device).view(-1, *[1] * decisions.dim())
        draws = keyed_uniform(self.seed, agents, decisions + later, self.n, self.STREAM)
        return self._sized(draws, dtype).movedim(0, decisions.dim())

    def _sized(self, draws: Tensor, dtype: torch.dtype) -> Tensor:
        amplitude = self.amplitude
        if isinstance(amplitude, Tensor):
            amplitude = amplitude.to(draws).unsqueeze(-1)
        return (amplitude * draws).to(dtype)

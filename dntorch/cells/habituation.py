r"""Habituative gates: transmitters that are spent by use and recover.

.. math:: \dot s_{ci} = \frac{1 - s_{ci}}{\tau_f} C_c I_i - \frac{s_{ci}}{\tau_r}

C is 1 for one context at most. It is given by its number, -1 for none: a row is found faster than
all rows are multiplied.
"""

import torch
from torch import Tensor

from dntorch.cells.functions import is_on, rectified
from dntorch.number import Number, either


def context_number(satisfaction: Tensor, recalled: Tensor) -> Tensor:
    """Number of the context of the last completions, int64 ``(*batch,)``, -1 while there is none.

    The last completion counts first: of i, j, k, with ``recalled`` ``(*batch, 2, n)``, it is
    ``i * n * n + j * n + k``.
    """
    n = satisfaction.shape[-1]
    number, known = satisfaction.argmax(-1), is_on(satisfaction).any(-1)
    for level in recalled.unbind(-2):
        number = number * n + level.argmax(-1)
        known = known & is_on(level).any(-1)
    return torch.where(known, number, -1)


@either
def habituation_step(
    number: Tensor, intention: Tensor, spent: Tensor, fatigue: Number, recovery: Number, dt: float
) -> Tensor:
    """One Euler step of ``dt`` seconds; ``spent`` is ``[context, behaviour]``."""
    numbers = torch.arange(spent.shape[-2], dtype=torch.int32, device=spent.device)
    here = numbers == number.to(torch.int32).unsqueeze(-1)  # half as long: twice as fast
    running = rectified(intention, 0.5) / fatigue  # the tails of those at rest would add up
    use = torch.where(here.unsqueeze(-1), running.unsqueeze(-2), 0)
    return spent + dt * ((1 - spent) * use - spent / recovery)


@either
def freshness(number: Tensor, spent: Tensor, sharpness: Number) -> Tensor:
    """What is left of the transmitters in this context, ``(*batch, n)``; 1 where there is none."""
    row = number.clamp_min(0)[..., None, None].expand(number.shape + (1, spent.shape[-1]))
    left = (1 - spent.gather(-2, row).squeeze(-2)) ** sharpness
    return torch.where((number < 0).unsqueeze(-1), torch.ones_like(left), left)

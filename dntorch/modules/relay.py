"""Elements of an architecture without dynamics of their own."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.functions import KINDS, sigmoid
from dntorch.cells.kernels import sites
from dntorch.checks import shown
from dntorch.parameters import Parameters

COMBINE = ("sum", "product")


class Relay(Parameters):
    r"""Shows the sum, or the product, of what reaches it; at once, without a state.

    .. math:: o(x) = f\Big(\sum_k S_k(x)\Big) \quad\text{or}\quad f\Big(\prod_k S_k(x)\Big)

    Args:
        shape: sites of each axis, an int for one.
        combine: ``"sum"`` or ``"product"`` of its links; what is given to it by hand is added.
        kind: output function, ``"linear"`` or one of those of `DNF`, with ``steepness`` and
            ``threshold``.

    Shapes: input and output ``(*batch, *shape)``.

    Raises:
        ValueError: an unknown combination or output function.

    >>> Relay(2, kind="heaviside")(torch.tensor([-1.0, 2.0]))
    tensor([0., 1.])
    """

    settable = ("kind",)
    shape: list[int]

    def __init__(
        self,
        shape: int | Sequence[int],
        combine: str = "sum",
        kind: str = "linear",
        steepness: float = 4.0,
        threshold: float = 0.0,
    ) -> None:
        super().__init__()
        self.register_buffer("origin", torch.zeros(()), persistent=False)
        self.shape, self.combine, self.kind = sites(shape), combine, kind
        self.steepness, self.threshold = steepness, threshold
        self._check_all()
        self._ready = True

    def _check_all(self) -> None:
        for name, known in (("combine", COMBINE), ("kind", KINDS)):
            word = getattr(self, name)
            if not isinstance(word, str) or word not in known:
                raise ValueError(f"{name}={shown(word)} is unknown: choose from {known}")

    def resize(self, *batch: int) -> "Relay":
        """Nothing of a relay has a batch."""
        return self

    def forward(self, combined: Tensor) -> Tensor:
        """What it shows of its links' sum or product."""
        if self.kind == "linear":
            return combined
        return sigmoid(combined, self.kind, self.steepness, self.threshold)

    def extra_repr(self) -> str:
        return f"{self.shape}, combine={self.combine!r}, kind={self.kind!r}"

"""Elements of an architecture without dynamics of their own."""

from collections.abc import Sequence

from torch import Tensor, nn

from dntorch.cells.functions import KINDS, sigmoid
from dntorch.modules.field import sites

COMBINE = ("sum", "product")


class Relay(nn.Module):
    r"""Shows the sum, or the product, of what reaches it; at once, without a state.

    .. math:: o(x) = f\Big(\sum_k S_k(x)\Big) \quad\text{or}\quad f\Big(\prod_k S_k(x)\Big)

    Args:
        shape: sites of each axis, an int for one.
        combine: ``"sum"`` or ``"product"`` of its links; what is given to it by hand is added.
        kind: output function, ``"linear"`` or one of those of `DNF`, with ``steepness`` and
            ``threshold``.

    Raises:
        ValueError: an unknown combination or output function.

    >>> Relay(2, kind="heaviside")(torch.tensor([-1.0, 2.0]))
    tensor([0., 1.])
    """

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
        self.shape = sites(shape)
        if combine not in COMBINE:
            raise ValueError(f"combine={combine!r} is unknown: choose from {COMBINE}")
        if kind not in KINDS:
            raise ValueError(f"kind={kind!r} is unknown: choose from {KINDS}")
        self.combine, self.kind = combine, kind
        self.steepness, self.threshold = float(steepness), float(threshold)

    def forward(self, combined: Tensor) -> Tensor:
        """What it shows of its links' sum or product."""
        if self.kind == "linear":
            return combined
        return sigmoid(combined, self.kind, self.steepness, self.threshold)

    def extra_repr(self) -> str:
        return f"{self.shape}, combine={self.combine!r}, kind={self.kind!r}"

"""From the output of one field to the input of another, of any axes."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from dntorch.cells.field import lateral
from dntorch.cells.kernels import Gauss, Global, Kernel, Matrices, borders_of, sites
from dntorch.cells.patterns import REDUCTIONS, diagonals, read_pattern, reduced
from dntorch.checks import LARGEST, check_dtype, check_ends, check_floats, shown
from dntorch.modules.kernelled import Kernelled
from dntorch.parameters import Parameters


class Projection(Kernelled, Parameters):
    r"""What one field gives to another: reduce axes, apply a kernel, expand along new axes.

    .. math:: S(y) = \sum_{x} \omega(y, x)\, \rho(x), \qquad
              \rho(x) = \operatorname{reduce}_{z} f(u(x, z))

    ====================  ==========================================================
    pattern ``axes``      what it does
    ====================  ==========================================================
    ``"x -> x"``          the same axis
    ``"y x -> x"``        contraction: ``reduce`` over y
    ``"x -> y x"``        expansion: the same for each y
    ``"y x -> x y"``      transposition
    ``"r g -> r+g"``      diagonals: over all pairs with the same sum, ``reduce``
    ``"r+g -> r g"``      expansion along the diagonals; the last two change a frame of
                          reference (retinal position and gaze make a bodily one)
    ====================  ==========================================================

    Axes have any names, up to three go through, and 0 axes are nodes: ``"x ->"``, ``"-> x"``. The
    kernel acts on the axes that go through, in the order of the target. On a sum of n and m sites
    there are ``n + m - 1``.

    Args:
        axes: the pattern.
        source, target: shapes without batch, an int for one axis.
        kernel: a gain; or terms as those of `DNF` (`Gauss`, `Global`); or `Matrices`, one
            ``[to, from]`` per axis that goes through, where it may change its size.
        border: ``"circular"`` or ``"zero"``, one for all or one per axis that goes through.
        reduce: ``"sum"``, ``"mean"``, ``"max"`` or ``"min"``.

    Shapes: ``(*batch, *source)`` to ``(*batch, *target)``. No state. ``projection.kernel`` reads
    and is set as that of a field, differentiable in the numbers of its terms.

    Raises:
        ValueError: a pattern that does not fit the shapes, an unknown reduction, a term that
            doesn't fit the axes; in a call, an input that doesn't end in ``source``.

    Source: the expansions and contractions of Zibner, Faubel, Iossifidis and Schöner, "Dynamic
    neural fields as building blocks of a cortex-inspired architecture for robotic scene
    representation", 2011. Not in the paper.

    >>> scene = torch.zeros(3, 5)
    >>> scene[2, 3] = 1.0
    >>> Projection("c p -> p", (3, 5), 5, 2.0)(scene)
    tensor([0., 0., 0., 2., 0.])
    >>> Projection("c p -> c+p", (3, 5), 7)(scene)  # 2 + 3
    tensor([0., 0., 0., 0., 0., 1., 0.])
    """

    settable = ("reduce",)
    # What `Kernelled` asks for: sizes of the axes that go through, in the target and the source.
    shape: list[int]
    source_shape: list[int]
    source: list[int]
    target: list[int]
    _through: list[str]
    _shear: list[int]
    _reduced: list[int]
    _order: list[int]
    _unshear: list[int]
    _placed: list[int]
    _new: list[int]

    def __init__(
        self,
        axes: str,
        source: int | Sequence[int],
        target: int | Sequence[int],
        kernel: float | Tensor | Kernel = 1.0,
        border: str | Sequence[str] = "circular",
        reduce: str = "sum",
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__()
        check_floats(dtype)
        self.register_buffer("origin", torch.zeros((), dtype=dtype), persistent=False)
        self.source, self.target = sites(source, "source"), sites(target, "target")
        route = read_pattern(axes, self.source, self.target)
        if len(route.middle_to) > 3:
            raise ValueError(f"axes={axes!r}: more than three axes go through: chain two")
        self.axes, self.border, self.reduce = axes, border, reduce
        self.shape, self.source_shape = route.middle_to, route.middle_from
        self._through = route.through
        self._shear, self._reduced, self._order = route.shear, route.reduced, route.order
        self._unshear, self._placed, self._new = route.unshear, route.placed, route.new
        self._check_all()
        self.kernel = kernel
        self._ready = True

    def _check_all(self) -> None:
        if self.reduce not in REDUCTIONS:
            raise ValueError(f"reduce={self.reduce!r} is unknown: choose from {REDUCTIONS}")

    def resize(self, *batch: int) -> "Projection":
        """Nothing of a projection has a batch."""
        return self

    def _terms_of(self, kernel: Any) -> Any:
        gain = isinstance(kernel, (int, float)) and not isinstance(kernel, bool)
        if not gain and not isinstance(kernel, Tensor):
            return super()._terms_of(kernel)
        one = abs(kernel) <= LARGEST if gain else kernel.numel() == 1 and not kernel.is_complex()
        if not one or not bool(torch.as_tensor(kernel).isfinite()):
            raise ValueError(f"kernel={shown(kernel)} is no gain: give one finite number, or terms")
        if isinstance(kernel, nn.Parameter) and kernel.dim() > 0:
            raise ValueError(
                f"kernel is a parameter of shape {list(kernel.shape)}: give one of shape []"
            )
        return float(kernel) if gain else kernel if kernel.dim() == 0 else kernel.reshape(())

    def _assembled(self, terms: Any) -> tuple[list[Tensor], float | Tensor]:
        if not isinstance(terms, (float, Tensor)):
            return super()._assembled(terms)
        borders_of(self.border, len(self.shape))
        if self.shape != self.source_shape:
            raise ValueError(
                f"kernel={terms} is a gain, but sizes {self.source_shape} become {self.shape}: "
                "give Matrices"
            )
        return [], terms

    def forward(self, output: Tensor) -> Tensor:
        """Input of the target, ``(*batch, *target)``."""
        check_ends("output", output, self.source)
        check_dtype("output", output, self.origin.dtype)
        if len(self._shear) > 0:
            output = diagonals(output, self._shear, self.reduce)
        x = reduced(output, self._reduced, self.reduce)
        if len(self._order) > 1:
            x = x.movedim(self._order, list(range(-len(self._order), 0)))
        if self._plain:
            x = self.everywhere * x
        else:
            x = lateral(x, self._stacks(), self.everywhere)
        if len(self._unshear) > 0:
            x = x.unfold(self._unshear[0], self._unshear[1], 1)
        if len(self._placed) > 1:
            x = x.movedim(list(range(-len(self._placed), 0)), self._placed)
        if len(self._new) == 0:
            return x
        batch = list(x.shape[: x.dim() - (len(self.target) - len(self._new))])
        for axis in self._new:  # from the outermost: those further in are not there yet
            place = axis + len(self.target) + len(batch)
            x = x.unsqueeze(place)
        return x.expand(batch + self.target)

    @property
    def reduces(self) -> bool:
        """Whether an axis or a diagonal is reduced."""
        return len(self._reduced) + len(self._shear) > 0

    def transpose(self) -> "Projection":
        """The projection backwards: the adjoint, ``(P x) . y == x . (P.transpose() y)``.

        Raises:
            ValueError: the projection takes a maximum or a minimum, which has none.
        """
        if self.reduce not in ("sum", "mean") and self.reduces:
            raise ValueError(f"reduce={self.reduce!r} has no adjoint: give 'sum' or 'mean'")
        if self.reduce == "mean" and self._shear:
            raise ValueError("reduce='mean' over diagonals has no adjoint here: give 'sum'")
        came, goes = self.axes.split("->")
        axes = f"{goes.strip()} -> {came.strip()}"
        kernel: Any = self.everywhere.detach().clone() if self._plain else self._turned(axes)
        if self.reduce == "mean":
            count = 1
            for axis in self._reduced:
                count *= self.source[axis]
            kernel = _scaled(kernel, 1 / count)
        return Projection(axes, self.target, self.source, kernel, dtype=self.origin.dtype)

    def _turned(self, axes: str) -> Any:
        """The kernel backwards, its axes in the order of a pattern ``axes``."""
        back = read_pattern(axes, self.target, self.source).through
        stacks = [self._stacks()[self._through.index(name)] for name in back]
        terms: list[Any] = [Matrices(tuple(m.t() for m in each)) for each in zip(*stacks)]
        if bool(self.everywhere != 0):
            terms.append(Global(self.everywhere.detach().clone()))
        return tuple(terms) if len(self.shape) else self.everywhere.detach().clone()

    def extra_repr(self) -> str:
        return f"{self.axes!r}, {self.source}, {self.target}, kernel={self.kernel!r}"


def _scaled(kernel: Any, factor: float) -> Any:
    if isinstance(kernel, Tensor):
        return kernel * factor
    return tuple(
        term._replace(amplitude=term.amplitude * factor)
        if isinstance(term, (Global, Gauss))
        else Matrices((term.matrices[0] * factor, *term.matrices[1:]))
        for term in kernel
    )

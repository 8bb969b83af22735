"""What holds a kernel: a field in itself, a projection between two."""

from typing import Any

import torch
from torch import Tensor
from torch.utils._pytree import tree_map

from dntorch.cells.kernels import Global, Kernel, Matrices, as_terms, assemble


class Kernelled:
    """A module whose kernel reads and is set as terms, and is held as matrices.

    A subclass has ``shape``, the sizes of its axes, ``source_shape`` where its kernel comes from
    other sizes, and ``border``.
    """

    __jit_unused_properties__ = ("kernel",)
    everywhere: Tensor
    kernel_0: Tensor
    kernel_1: Tensor
    kernel_2: Tensor

    @property
    def kernel(self) -> Any:
        """Terms, as they were set; as `Matrices` once the matrices were changed otherwise."""
        if self.everywhere.is_meta:
            return self._terms
        matrices, everywhere = self._assembled(self._terms)
        built, stacks = [*matrices, _wide(everywhere)], self._stacks()[: len(matrices)]
        # In float32: what was rounded to it and moved to float64 is the same kernel.
        pairs = zip(built, [*stacks, self.everywhere])
        if all(torch.equal(x.to(y).float(), y.float()) for x, y in pairs):
            return self._terms
        terms = [Matrices(tuple(each)) for each in zip(*(stack.unbind() for stack in stacks))]
        whole = [Global(float(self.everywhere))] if bool(self.everywhere != 0) else []
        return (*terms, *whole)

    @kernel.setter
    def kernel(self, kernel: Any) -> None:
        terms = self._terms_of(kernel)
        matrices, everywhere = self._assembled(terms)  # may refuse
        self._terms = terms
        self._place("everywhere", _wide(everywhere).to(self.origin))
        for axis in range(3):
            stack = matrices[axis] if axis < len(matrices) else torch.empty(0)
            self._place(f"kernel_{axis}", stack.to(self.origin))

    def _terms_of(self, kernel: Any) -> Kernel:
        return as_terms(kernel)

    def _assembled(self, terms: Any) -> tuple[list[Tensor], float | Tensor]:
        source = getattr(self, "source_shape", None)
        return assemble(terms, self.shape, self.border, source)

    def __getstate__(self) -> dict[str, Any]:
        cut = tree_map(lambda x: x.detach() if isinstance(x, Tensor) else x, self._terms)
        return super().__getstate__() | {"_terms": cut}

    def _stacks(self) -> list[Tensor]:
        return [self.kernel_0, self.kernel_1, self.kernel_2][: len(self.shape)]


def _wide(number: float | Tensor) -> Tensor:
    """A number in float64, as matrices are built; a plain `as_tensor` rounds it to float32."""
    return torch.as_tensor(number, dtype=torch.float64)

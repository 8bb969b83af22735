"""What holds a kernel: a field in itself, a projection between two."""

from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._pytree import tree_map

from dntorch.cells.kernels import Global, Kernel, Matrices, as_terms, assemble
from dntorch.checks import shown

HELD = ("everywhere", "kernel_0", "kernel_1", "kernel_2")


class Kernelled:
    """A module whose kernel reads and is set as terms, and is held as matrices.

    A subclass has ``shape``, the sizes of its axes, ``source_shape`` where its kernel comes from
    other sizes, and ``border``.
    """

    __jit_unused_properties__ = ("kernel",)
    _plain: bool = False
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
        if self._plain:
            return float(self.everywhere)
        terms = [Matrices(tuple(each)) for each in zip(*(stack.unbind() for stack in stacks))]
        whole = [Global(float(self.everywhere))] if bool(self.everywhere != 0) else []
        return (*terms, *whole)

    @kernel.setter
    def kernel(self, kernel: Any) -> None:
        terms = self._terms_of(kernel)
        matrices, everywhere = self._assembled(terms)  # may refuse
        built = [_wide(everywhere), *matrices, *[torch.empty(0)] * (3 - len(matrices))]
        held = [x.to(self.origin) for x in built]
        if not all(x.is_meta or bool(x.isfinite().all()) for x in held):
            raise ValueError(
                f"kernel={shown(kernel)} is not finite in {self.origin.dtype}: give smaller numbers"
            )
        self.__dict__["_terms"] = terms  # past `nn.Module`, which would register a parameter
        self._plain = isinstance(terms, (float, Tensor))
        own = isinstance(everywhere, nn.Parameter)  # which an optimizer may already hold
        self._place("everywhere", everywhere if own else held[0])
        for axis in range(3):
            self._place(f"kernel_{axis}", held[1 + axis])

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "kernel":  # `nn.Module` would register a parameter, past the property
            Kernelled.kernel.fset(self, value)
            return
        if name in HELD and self.__dict__.get("_ready", False):
            self._check_held(name, value)
        super().__setattr__(name, value)

    def _check_held(self, name: str, value: Any) -> None:
        """Raise unless a tensor may stand in the place of one of the kernel's."""
        before = getattr(self, name)
        free = 0 if name == "everywhere" else 1  # the number of terms
        if not isinstance(value, Tensor):
            raise TypeError(f"{name} is a {type(value).__name__}: give a tensor")
        if value.dim() != before.dim() or value.shape[free:] != before.shape[free:]:
            raise ValueError(
                f"{name} of shape {list(value.shape)} does not fit {list(before.shape)}: give "
                "matrices (terms, to, from)"
            )
        if not value.is_meta and not bool(value.isfinite().all()):
            raise ValueError(f"{name} is not finite: give numbers")

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

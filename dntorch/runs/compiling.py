"""A step of a run, compiled: between moments of fixed addresses, and where nothing can compile."""

import time
import warnings
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

UNCOMPILED = (
    "the step could not be compiled ({}), so the run goes on slower: to compile, give a C++ "
    "compiler that works, and a TORCHINDUCTOR_CACHE_DIR to write to, without spaces in its name"
)

ENTRIES = {"recompile_limit": 10_000, "accumulated_recompile_limit": 10_000}
"""Of the compiler, for one function: of eight, its default, a ninth engine of other sizes in a
process would not run."""


def overwrite(moment: Any, other: Any) -> None:
    """Copy every number of another moment into this one."""
    for own, new in zip(pytree.tree_leaves(moment), pytree.tree_leaves(other)):
        if own is not new:
            own.copy_(new)


class Compiled:
    """A compiled function, which says how long its first call took.

    Where the compiler or its cache does not work, it runs as it is, slower, with a warning.

    Attributes:
        failed: it runs as it is.
        sure: nothing but the numbers has changed since the last call, so that the compiler need
            not look. Whoever lets others set a parameter in between makes it False.
    """

    def __init__(self, function: Callable) -> None:
        self.plain, self.function = function, None
        self.seconds, self.sure, self.failed = 0.0, False, False

    def __call__(self, *inputs: Any) -> Any:
        if self.failed:
            return self.plain(*inputs)
        if self.sure:
            with torch.compiler.set_stance("default", skip_guard_eval_unsafe=True):
                return self.function(*inputs)
        began = time.monotonic()
        try:
            if self.function is None:
                self.function = torch.compile(self.plain, fullgraph=True, dynamic=False)
            with torch._dynamo.config.patch(ENTRIES):
                result = self.function(*inputs)
        except Exception as error:
            if not _is_of_the_machine(error):
                raise
            self.failed = True
            warnings.warn(UNCOMPILED.format(str(error).splitlines()[0]), stacklevel=2)
            return self.plain(*inputs)
        self.seconds = self.seconds or time.monotonic() - began
        self.sure = True
        return result


def _is_of_the_machine(error: Exception) -> bool:
    """Whether compiling failed for what the machine lacks, not for what the step does.

    After an OSError the compiler may be half imported: to ask it for its errors would fail.
    """
    return isinstance(error, OSError) or isinstance(error, torch._dynamo.exc.BackendCompilerFailed)


class Alternating:
    """A compiled step between two moments of fixed addresses, which take turns.

    What is read is never written in the same step, so nothing is copied twice, and the
    compiler keeps one entry: addresses and strides never change.
    """

    def __init__(self, step: Callable[[Any, Any], Any]) -> None:
        def write(moment: Any, chance: Any, target: Any) -> None:
            overwrite(target, step(moment, chance))

        self.step, self.write = step, Compiled(write)
        self.target: Any = None

    def __call__(self, moment: Any, chance: Any) -> Any:
        if self.target is None:
            self.target = self._spare(moment, chance)
        self.write(moment, chance, self.target)
        self.target, moment = moment, self.target
        return moment

    def _spare(self, moment: Any, chance: Any) -> Any:
        """Room for the next moment; what a step hands on as it is, it shares with this one."""
        after = self.step(moment, chance)  # only to see what is handed on: the next call repeats it

        def room(own: Tensor, new: Tensor) -> Tensor:
            return own if own is new else own.clone()

        return pytree.tree_map(room, moment, after)

"""Parameters of equations: one number for all, or a tensor with one number per agent."""

import ast
import inspect
import itertools
import linecache
import math
import textwrap
from collections.abc import Callable
from typing import TypeVar

import torch
from torch import Tensor

Number = float | Tensor
"""A float, or a tensor of the batch's shape ``(*batch,)`` (of shape ``()``: the same for all)."""

F = TypeVar("F", bound=Callable)


def either(function: F) -> F:
    """Let TorchScript compile a function for floats and for tensors where it says `Number`.

    TorchScript gives a parameter one type; so each combination becomes an overload of the
    function. Python itself calls the function as it is.
    """
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    types = {each.arg: ast.unparse(each.annotation) for each in node.args.args}
    result, numbers = ast.unparse(node.returns), [k for k, v in types.items() if v == "Number"]
    for k, kinds in enumerate(itertools.product(("float", "Tensor"), repeat=len(numbers))):
        chosen = types | dict(zip(numbers, kinds))
        takes = ", ".join(f"{name}: {kind}" for name, kind in chosen.items())
        gives = kinds[0] if result == "Number" else result
        source = f"def {function.__name__}({takes}) -> {gives}:\n    pass\n"
        file = f"<overload {k} of {function.__module__}.{function.__qualname__}>"
        linecache.cache[file] = (len(source), None, source.splitlines(True), file)
        exec(compile(source, file, "exec"), dict(function.__globals__), made := {})
        overload = made[function.__name__]
        overload.__module__, overload.__qualname__ = function.__module__, function.__qualname__
        # TorchScript reads the types in the source; of these it only asks that there are some.
        overload.__annotations__ = dict.fromkeys([*types, "return"], Tensor)
        torch.jit._overload(overload)
    return function


@either
def wide(number: Number, dims: int) -> Number:
    """A number per agent with the trailing dimensions of a structure, ``(*batch, 1, …)``."""
    if isinstance(number, float):
        return number
    return number.reshape(list(number.shape) + [1] * dims)


@either
def plus(x: Tensor, gain: Number, y: Tensor) -> Tensor:
    """``x + gain * y`` in one operation: in eager mode a product with a float costs three."""
    if isinstance(gain, float):
        return torch.add(x, y, alpha=gain)
    return torch.addcmul(x, gain, y)


def span(number: Number) -> tuple[float, float]:
    """The smallest and the largest of one or many numbers."""
    if isinstance(number, Tensor):
        if number.numel() == 0:  # of a batch without members: nothing is too small or too large
            return math.inf, -math.inf
        return float(number.detach().min()), float(number.detach().max())
    return number, number

"""What inputs and parameters must be; each sentence names argument, value and remedy."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

import torch
from torch import Tensor

from dntorch.number import Number, span

LARGEST = torch.finfo(torch.float32).max
"""What is beyond it becomes infinite in float32."""


def check_ends(name: str, tensor: Tensor, end: list[int]) -> None:
    """Raise unless the last dimensions of an input are ``end``; it would broadcast in silence."""
    if not isinstance(tensor, Tensor):
        refuse_input(name, tensor)
    given = list(tensor.shape)
    if given[len(given) - len(end) :] != end:
        raise ValueError(
            f"{name} of shape {given} does not end in {end} after its batch: reshape it, or build "
            "the structure with another size"
        )


@torch.jit.ignore
def refuse_input(name: str, value: Tensor) -> None:
    raise TypeError(
        f"{name} is a {type(value).__name__}: give a tensor, such as torch.as_tensor({name})"
    )


def check_time_constant(name: str, tau: Number, dt: float) -> None:
    """Raise unless an explicit step of ``dt`` can follow a decay with time constant ``tau``."""
    shortest, _ = span(tau)
    check_positive(name, tau, "give seconds")
    if dt > shortest:
        raise ValueError(
            f"dt={dt} is longer than {name}={shortest}: an explicit step would overshoot; "
            "take a smaller dt, or sub-steps"
        )


def check_positive(name: str, number: Number, remedy: str = "give a number above 0") -> None:
    """Raise unless a number, or each of many, is above zero."""
    low = None if number is None else span(_number(name, number))[0]
    if low is None or not low > 0:
        raise ValueError(f"{name}={low} must be positive: {remedy}")


def check_negative(name: str, number: Number, why: str) -> None:
    """Raise unless a number, or each of many, is below zero."""
    _, high = span(number)
    if not high < 0:
        raise ValueError(f"{name}={high} must be negative: {why}")


def check_count(name: str, number: int, least: int = 1) -> None:
    """Raise unless a number is whole and large enough."""
    if not isinstance(number, int) or isinstance(number, bool) or not least <= number < 2**63:
        words = ("none", "one", "two")
        raise ValueError(f"{name}={shown(number)}: give at least {words[least]}, a whole number")


def check_states(n: int, states: int | None) -> int:
    """How many states ``n`` behaviours are paired with, by default as many; or raise."""
    if states is None:
        return n
    check_count("states", states)
    if states % n:
        raise ValueError(
            f"states={states} is no multiple of n={n}: give n, or the states of a Recall(n)"
        )
    return states


def check_finite_number(name: str, number: float) -> None:
    """Raise unless it is one finite number, which a float holds."""
    whole = isinstance(number, int | float) and not isinstance(number, bool)
    if not whole or not abs(number) <= LARGEST:
        raise ValueError(f"{name}={shown(number)} is not finite: give a number")


def check_dtype(name: str, tensor: Tensor, dtype: torch.dtype) -> None:
    """Raise unless an input has the dtype of what takes it; some of it would round in silence."""
    if tensor.dtype != dtype:
        raise ValueError(
            f"{name} of dtype {tensor.dtype} does not fit {dtype}: give {name}.to({dtype}), or "
            "build the structure with another dtype"
        )


def check_named(name: str, given: Any) -> None:
    """Raise unless tensors come by name."""
    if not isinstance(given, Mapping):
        raise TypeError(f"{name} is a {type(given).__name__}: give a dict by name")


def check_entries(state: Any, labels: list[str], shapes: dict[str, list[int]]) -> None:
    """Raise unless a state by name has a tensor for each of ``labels``, of its shape."""
    check_named("state", state)
    for label in labels:
        if label not in state:
            raise ValueError(f"state has no {label!r}: give what state or initial(batch) is")
        check_ends(label, state[label], shapes[label])


def check_floats(dtype: Any) -> None:
    """Raise unless it is a dtype of real floats, or None."""
    if dtype is not None and not (isinstance(dtype, torch.dtype) and dtype.is_floating_point):
        raise TypeError(f"dtype={shown(dtype)} has no floats: give torch.float32 or torch.float64")


def _number(name: str, number: Any) -> Any:
    """A number, or a tensor of numbers; or raise."""
    real = isinstance(number, Real) and not isinstance(number, bool)
    if not real and not (isinstance(number, Tensor) and not number.is_complex()):
        raise TypeError(f"{name}={shown(number)} is no number: give a float")
    return number


def shown(value: Any) -> str:
    """A value in one line, cut where it is long."""
    text = " ".join(repr(value)[:400].split())
    return text if len(text) <= 80 else text[:77] + "..."


def check_real(name: str, tensor: Tensor) -> None:
    """Raise unless it is a tensor of floats."""
    if not isinstance(tensor, Tensor):
        refuse_input(name, tensor)
    if not tensor.is_floating_point():
        raise TypeError(f"{name} of dtype {tensor.dtype} has no floats: give {name}.float()")


def check_no_nan(name: str, tensor: Tensor) -> None:
    """Raise if a number is NaN, where `count` sees any."""
    bad = count(tensor.isnan())
    if bad:
        raise ValueError(f"{name} has {bad} NaN of {tensor.numel()} numbers: mend what made them")


def check_within(name: str, tensor: Tensor, low: float, high: float) -> None:
    """Raise unless all numbers are in a range, where `count` sees any."""
    if count(~((tensor >= low) & (tensor <= high))):
        worst = max(tensor.detach().flatten().tolist(), key=lambda x: max(low - x, x - high))
        raise ValueError(f"{name}={worst} is out of range: give {low} to {high}")


def count(bad: Tensor) -> int:
    """How many are bad; 0 under `compile`, `export` and `vmap`, which see no numbers."""
    if torch.compiler.is_compiling() or torch.jit.is_tracing():
        return 0
    try:
        return int(bad.sum())
    except RuntimeError:  # of vmap
        return 0

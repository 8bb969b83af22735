"""What inputs and parameters must be; each sentence names argument, value and remedy."""

import math

import torch
from torch import Tensor

from dntorch.number import Number, span


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
    low = None if number is None else span(number)[0]
    if low is None or not low > 0:
        raise ValueError(f"{name}={low} must be positive: {remedy}")


def check_negative(name: str, number: Number, why: str) -> None:
    """Raise unless a number, or each of many, is below zero."""
    _, high = span(number)
    if not high < 0:
        raise ValueError(f"{name}={high} must be negative: {why}")


def check_count(name: str, number: int, least: int = 1) -> None:
    """Raise unless a number is whole and large enough."""
    if not isinstance(number, int) or isinstance(number, bool) or number < least:
        words = ("none", "one", "two")
        raise ValueError(f"{name}={number!r}: give at least {words[least]}, a whole number")


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
    """Raise unless it is one finite number."""
    whole = isinstance(number, int | float) and not isinstance(number, bool)
    if not whole or not math.isfinite(number):
        raise ValueError(f"{name}={number!r} is not finite: give a number")


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

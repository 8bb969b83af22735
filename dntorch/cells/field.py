r"""Dynamic neural fields of any number of dimensions.

.. math:: \tau \dot u(x) = -u(x) + h + S(x) + \sum_{x'} \omega(x, x') f(u(x'))

The kernel comes as `dntorch.cells.kernels.assemble` gives it: ``kernels``, for each axis a
stack of matrices ``(terms, n, n)``, and ``everywhere``, the amplitude of its global term.
Dense matrices, since up to some hundred sites an axis they beat convolution and FFT on a
CPU, and borders, asymmetric and learned kernels come free.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import linear

from dntorch.cells.functions import sigmoid
from dntorch.number import Number, either


class FieldState(NamedTuple):
    u: Tensor
    """Activation, ``(*batch, *shape)``."""


def separable(output: Tensor, kernels: list[Tensor], term: int) -> Tensor:
    """Effect of one term: multiply the last axis by its matrix, rotate the axes, repeat."""
    axes = len(kernels)
    if axes == 2:  # the same bits in a tenth to a third less time: nothing is left transposed
        return torch.matmul(kernels[0][term], linear(output, kernels[1][term]))
    for axis in range(axes):
        output = linear(output, kernels[axes - 1 - axis][term])
        if axes > 1:
            output = output.movedim(-1, -axes)
    return output


@either
def lateral(output: Tensor, kernels: list[Tensor], everywhere: Number) -> Tensor:
    r"""Lateral interaction :math:`\sum_{x'} \omega(x, x') f(u(x'))` of ``(*batch, *shape)``."""
    axes = len(kernels)
    if axes == 0:
        return everywhere * output
    total = separable(output, kernels, 0)
    for term in range(1, kernels[0].shape[0]):
        total = total + separable(output, kernels, term)
    if axes == 1:  # where it is in the matrix
        return total
    return total + everywhere * output.sum(list(range(-axes, 0)), keepdim=True)


@either
def field_target(
    input: Tensor,
    state: FieldState,
    kernels: list[Tensor],
    everywhere: Number,
    h: Number,
    kind: str,
    steepness: float,
    threshold: float,
) -> Tensor:
    """Where the leak pulls ``u``: all of the right-hand side but ``-u``."""
    output = sigmoid(state.u, kind, steepness, threshold)
    return lateral(output, kernels, everywhere) + input + h


@either
def field_rate(
    input: Tensor,
    state: FieldState,
    kernels: list[Tensor],
    everywhere: Number,
    tau: Number,
    h: Number,
    kind: str,
    steepness: float,
    threshold: float,
) -> FieldState:
    """Right-hand side, per second."""
    target = field_target(input, state, kernels, everywhere, h, kind, steepness, threshold)
    return FieldState((target - state.u) / tau)


@either
def field_relax(
    input: Tensor,
    output: Tensor,
    state: FieldState,
    kernels: list[Tensor],
    everywhere: Number,
    tau: Number,
    h: Number,
    dt: float,
) -> FieldState:
    """One Euler step of ``dt`` seconds from a state whose output is known."""
    target = lateral(output, kernels, everywhere) + input + h
    return FieldState(state.u.lerp(target, dt / tau))


@either
def field_step(
    input: Tensor,
    state: FieldState,
    kernels: list[Tensor],
    everywhere: Number,
    tau: Number,
    h: Number,
    kind: str,
    steepness: float,
    threshold: float,
    dt: float,
) -> FieldState:
    """One Euler step of ``dt`` seconds."""
    output = sigmoid(state.u, kind, steepness, threshold)
    return field_relax(input, output, state, kernels, everywhere, tau, h, dt)

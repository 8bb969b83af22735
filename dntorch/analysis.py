r"""Fixed points of a node: where its rate of change is zero, and whether it stays there."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import sigmoid
from dntorch.checks import LARGEST, check_no_nan, shown
from dntorch.modules.field import DNF
from dntorch.modules.node import NodeWTA
from dntorch.number import Number

TOUCHING = 1e-12
"""Rate at a turn, per size of its terms, below which the curve touches zero without crossing."""


class FixedPoint(NamedTuple):
    """An activation that stays where it is."""

    u: float
    stable: bool
    """Whether it is returned to after a small push to either side."""


class Node(NamedTuple):
    r"""One node as an equation, :math:`\tau \dot u = -u + h + S + c f(u)`."""

    tau: float
    h: float
    gain: float
    kind: str
    steepness: float
    threshold: float
    floor: float | None

    def rate(self, input: float | Tensor, u: Tensor) -> Tensor:
        """Right-hand side, per second."""
        output = sigmoid(u, self.kind, self.steepness, self.threshold)
        return (self.h + input + self.gain * output - u) / self.tau


def fixed_points(
    node: DNF | NodeWTA, input: float | Tensor
) -> list[FixedPoint] | list[list[FixedPoint]]:
    r"""All fixed points of a node for a constant input, from the lowest to the highest.

    .. math:: 0 = -u + h + S + c f(u), \qquad
              \text{stable where} \quad -1 + c f'(u) < 0

    ``node`` is a field without axes, ``DNF(())``, or a ``NodeWTA`` of one node; its state plays
    no part. With a number as ``input``, a list; with a tensor of shape ``(k,)``, a list of such
    lists, one per input, for a bifurcation diagram.

    **None is missed.** A sigmoid is steepest at its threshold, so the rate turns at two places
    at most, where :math:`f'(u) = 1/c`. They are known in closed form; between them it is
    monotone, and each piece that changes its sign is halved to the last bit, in float64.

    * *Bistable*, between the two inputs at which it turns: stable, unstable, stable.
    * *Tangent*, at a turn, where two fixed points meet: one entry at the turn, ``stable=False``,
      since it is left to one side. This counts within rounding, so that two fixed points nearer
      to each other than about 1e-6 may be one.
    * *Heaviside*: f jumps at the threshold, and where the rate changes its sign in the jump, the
      threshold is an entry, as in the limit of steep sigmoids: unstable with ``c > 0``, stable
      with ``c < 0``, where the activation is driven back from both sides.
    * *Semi-linear* output has no bound: with ``c * steepness > 1`` the upper fixed point is
      unstable, and beyond it, or without it, the activation grows for ever; the list may be empty.
    * *A floor* of a ``NodeWTA``: nothing is below it, and it is stable where the rate on it is
      negative.

    Stability is that of the equation. Euler steps of ``dt`` swing around a stable fixed point
    without end where :math:`-1 + c f'(u) < -2 \tau / \text{dt}`.

    Raises:
        TypeError: ``node`` is neither of the two.
        ValueError: more than one node, parameters per member of a batch, an input of more than one
            dimension or not finite.

    >>> from dntorch import DNF, Global
    >>> node = DNF((), [Global(6.0)])
    >>> [(round(u, 2), stable) for u, stable in fixed_points(node, 2.0)]
    [(-3.0, True), (0.0, False), (3.0, True)]
    >>> [len(points) for points in fixed_points(node, torch.tensor([0.0, 2.0, 4.0]))]
    [1, 3, 1]
    """
    one, inputs = equation(node), as_inputs(input)
    flat = inputs.reshape(-1)
    find = {"heaviside": _at_jump, "semilinear": _at_kink}.get(one.kind, _between_turns)
    found = [_above_floor(points, one, s) for points, s in zip(find(one, flat), flat.tolist())]
    return found[0] if inputs.dim() == 0 else found


def equation(node: DNF | NodeWTA) -> Node:
    """The numbers of a node; or raise."""
    if isinstance(node, NodeWTA) and node.n == 1:
        numbers = {"tau": node.tau, "h": node.h, "gain": node.excitation}
        rest = ("abs", node.steepness, node.threshold, node.floor)
    elif isinstance(node, DNF) and not node.shape:
        numbers = {"tau": node.tau, "h": node.h, "gain": node.everywhere}
        rest = (node.kind, node.steepness, node.threshold, None)
    elif isinstance(node, DNF | NodeWTA):
        size = f"shape={node.shape}" if isinstance(node, DNF) else f"n={node.n}"
        raise ValueError(f"node of {size} is more than one: give DNF(()) or NodeWTA(1)")
    else:
        raise TypeError(f"node is a {type(node).__name__}: give DNF(()) or NodeWTA(1)")
    return Node(*(_single(name, number) for name, number in numbers.items()), *rest)


def _single(name: str, number: Number) -> float:
    if isinstance(number, Tensor) and number.numel() != 1:
        raise ValueError(f"{name} has {number.numel()} numbers: give one member, node.select(k)")
    return float(number)


def as_inputs(input: float | Tensor) -> Tensor:
    try:
        if isinstance(input, (str, bool)) or (isinstance(input, Tensor) and input.is_complex()):
            raise TypeError
        inputs = torch.as_tensor(input, dtype=torch.float64).detach().cpu()
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise TypeError(
            f"input={shown(input)} is no number: give a float, or a tensor (k,)"
        ) from None
    if inputs.dim() > 1:
        raise ValueError(
            f"input of shape {list(inputs.shape)} has too many dimensions: give a number, or "
            "numbers (k,)"
        )
    check_no_nan("input", inputs)
    if bool((inputs.abs() > LARGEST).any()):
        raise ValueError(f"input={shown(input)} is not finite: give numbers")
    return inputs


def _turns(node: Node) -> list[float]:
    """Where the rate turns, :math:`c f'(u) = 1`: at none or two places."""
    strength = node.gain * node.steepness
    if node.kind == "logistic" and strength > 4:  # c b p (1 - p) = 1
        half = math.acosh(math.sqrt(strength) / 2) * 2 / node.steepness
    elif node.kind == "abs" and strength > 2:  # c b / 2 = (1 + b |x|) ** 2
        half = (math.sqrt(strength / 2) - 1) / node.steepness
    else:
        return []
    return [node.threshold - half, node.threshold + half]


def _between_turns(node: Node, inputs: Tensor) -> list[list[FixedPoint]]:
    """Fixed points of a smooth node, per input: at most one per monotone piece."""
    turns, rest = _turns(node), inputs + node.h
    room = 1 + 1e-9 * rest.abs()  # which rounding leaves of it
    lowest = torch.stack((rest, rest + node.gain)).amin(0) - room  # f is within 0 and 1
    highest = torch.stack((rest, rest + node.gain)).amax(0) + room
    if turns:
        lowest, highest = lowest.clamp_max(turns[0] - 1), highest.clamp_min(turns[1] + 1)
    edges = torch.stack([lowest, *(torch.full_like(rest, turn) for turn in turns), highest])
    signs = node.rate(inputs, edges) * node.tau
    size = 1 + rest.abs() + abs(node.gain) + abs(node.threshold)
    signs = torch.where(signs.abs() <= TOUCHING * size, 0, signs).sign()
    u = _halved(node, inputs, edges[:-1], edges[1:])
    points: list[list[FixedPoint]] = [[] for _ in inputs]
    for piece, k in (signs[:-1] * signs[1:] < 0).nonzero().tolist():
        points[k].append(FixedPoint(float(u[piece, k]), piece != 1))
    for turn, k in (signs[1:-1] == 0).nonzero().tolist():
        points[k].append(FixedPoint(turns[turn], False))
    return [sorted(each) for each in points]


def _halved(node: Node, inputs: Tensor, left: Tensor, right: Tensor) -> Tensor:
    """Bisection until neighbours in float64; means nothing where the rate keeps its sign."""
    falls = node.rate(inputs, left) > 0
    middle = (left + right) / 2
    while bool(((middle != left) & (middle != right)).any()):
        before = (node.rate(inputs, middle) > 0) == falls  # the zero lies to the right
        left, right = torch.where(before, middle, left), torch.where(before, right, middle)
        middle = (left + right) / 2
    return middle


def _at_jump(node: Node, inputs: Tensor) -> list[list[FixedPoint]]:
    """Fixed points of a node whose output jumps from 0 to 1 at the threshold."""
    points = []
    for below in (inputs + node.h).tolist():
        above, edge = below + node.gain, node.threshold
        found = [FixedPoint(below, True)] if below < edge else []
        if min(below, above) <= edge <= max(below, above):
            touched = edge in (below, above)
            found.append(FixedPoint(edge, node.gain < 0 or (touched and node.gain == 0)))
        points.append(found + ([FixedPoint(above, True)] if above > edge else []))
    return points


def _at_kink(node: Node, inputs: Tensor) -> list[list[FixedPoint]]:
    """Fixed points of a node whose output is a line above the threshold and zero below."""
    slope, edge, points = node.gain * node.steepness - 1, node.threshold, []
    for below in (inputs + node.h).tolist():
        found = [FixedPoint(below, below < edge or slope < 0)] if below <= edge else []
        above = edge - (below - edge) / slope if slope else edge
        points.append(found + ([FixedPoint(above, slope < 0)] if above > edge else []))
    return points


def _above_floor(points: list[FixedPoint], node: Node, input: float) -> list[FixedPoint]:
    """What a floor leaves of them, and the floor where the rate presses on it."""
    if node.floor is None:
        return points
    kept = [point for point in points if point.u >= node.floor]
    rate = node.rate(*torch.tensor([input, node.floor], dtype=torch.float64))
    return [FixedPoint(node.floor, True), *kept] if rate < 0 else kept

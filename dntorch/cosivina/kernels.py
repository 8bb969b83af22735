"""Kernels and stimuli of COSIVINA in the terms of this library, number for number."""

import math

import torch
from torch import Tensor

from dntorch.cells.kernels import LARGEST, Gauss, Global, Matrices
from dntorch.cosivina.files import Element, Size
from dntorch.cosivina.parts import AXES, Map, names, shape


def each_axis(element: Element, name: str, size: Size, flag: bool = False) -> list[float]:
    """A parameter for each axis of more than one site: ``sigma`` of a line, else ``sigmaY``…"""
    wanted = [name + ending(element, k) for k, n in enumerate(size) if n > 1]
    if flag:
        return [element.flag(each) for each in wanted]
    return [element.number(each, least=0.0) for each in wanted]


def ending(element: Element, k: int) -> str:
    """How the parameters of axis ``k`` end: a line has one axis, which needs no letter."""
    return "" if element.kind.endswith("1D") else AXES[k].upper()


def gaussian(
    element: Element, amplitude: float, sigma: list[float], reach: list[int] | None = None
) -> tuple[Gauss, ...]:
    """A term, cut off where COSIVINA cuts; none if it is zero.

    A kernel reaches ``ceil(cutoff * sigma)`` sites, and where two share a range the narrower
    reaches as far as the wider.
    """
    cutoff, normalized = element.number("cutoffFactor", 5.0, least=0.0), element.flag("normalized")
    if amplitude == 0:
        return ()
    if reach is not None:  # on one axis
        (width,), (sites,) = sigma, reach
        cutoff = (sites - 0.5) / width if width > 0 and sites > 0 else 0.0
    if cutoff == 0:  # the site itself alone
        sigma, cutoff = [0.0] * len(sigma), 1.0
    return (Gauss(amplitude, _same(sigma), cutoff=cutoff, normalized=normalized),)


def _same(sigma: list[float]) -> float | tuple[float, ...]:
    """One width for all axes, if they have the same."""
    return sigma[0] if len(set(sigma)) == 1 else tuple(sigma)


def gaussians(element: Element, size: Size, suffixes: tuple[str, ...], shared: bool) -> Map:
    """The map of a kernel element: a Gaussian for each suffix, the second inhibits.

    Args:
        suffixes: ``("",)`` for a single Gaussian, else ``("Exc", "Inh")``.
        shared: on one axis both reach as far as the wider.
    """
    amplitudes = [element.number(f"amplitude{suffix}") for suffix in suffixes]
    sigmas = [each_axis(element, f"sigma{suffix}", size) for suffix in suffixes]
    circular = each_axis(element, "circular", size, flag=True)
    reach = None
    if shared and len(shape(size)) == 1:
        widest = max(sigma[0] * (a != 0) for sigma, a in zip(sigmas, amplitudes))
        reach = [math.ceil(element.number("cutoffFactor", 5.0, least=0.0) * widest)]
    terms: tuple = ()
    for sign, amplitude, sigma in zip((1.0, -1.0), amplitudes, sigmas):
        terms += gaussian(element, sign * amplitude, sigma, reach)
    if "amplitudeGlobal" in element.parameters:
        terms += whole(element.number("amplitudeGlobal"))
    border = tuple("circular" if ring else "zero" for ring in circular)
    return mapped(size, terms, border)


def whole(amplitude: float) -> tuple[Global, ...]:
    """A global term; none if it is zero."""
    return (Global(amplitude),) if amplitude != 0 else ()


def mapped(size: Size, terms: tuple, border: tuple[str, ...]) -> Map:
    """The map of a kernel between patterns of one size; on a single site it is a gain."""
    own = names(size)
    if not own:
        return Map((), (), sum(_alone(term) for term in terms))
    return Map(own, own, 1.0, terms, border) if terms else Map(own, own, 0.0)


def _alone(term: Gauss | Global | Matrices) -> float:
    """What a term gives a single site."""
    if isinstance(term, Matrices):
        return math.prod(float(matrix) for matrix in term.matrices)
    return float(term.amplitude)


def _check_matrix(element: Element, n: int, ring: int = 0) -> None:
    """Raise unless a matrix of ``n`` sites, or a ring, fits into the memory."""
    if n * max(n, ring) > LARGEST or ring > LARGEST:
        raise element.error(f"{max(n, ring)} sites are too many for a matrix: take fewer")


def fourier(element: Element, size: Size, circular: list[bool], padding: float) -> Map:
    """The map of a kernel that COSIVINA applies by FFT: without cutoff, also over a border."""
    sizes, terms = shape(size), ()
    pairs = [(element.number("amplitudeExc"), _widths(element, "sigmaExc", len(sizes)))]
    inhibition = -element.number("amplitudeInh", 0.0)
    if inhibition != 0:
        pairs.append((inhibition, _widths(element, "sigmaInh", len(sizes))))
    pairs = [(amplitude, sigma) for amplitude, sigma in pairs if amplitude != 0]
    widest = [max((sigma[k] for _, sigma in pairs), default=0.0) for k in range(len(sizes))]
    normalized = element.flag("normalized")
    for amplitude, sigma in pairs:
        if all(circular):
            reach = max((n / s for n, s in zip(sizes, sigma) if s > 0), default=1.0)
            terms += (Gauss(amplitude, _same(sigma), cutoff=reach, normalized=normalized),)
            continue
        for n, w in zip(sizes, widest):
            _check_matrix(element, n, n + 2 * math.ceil(padding * w))
        matrices = [
            _ring(n, s, 0 if ring else math.ceil(padding * w), normalized)
            for n, s, w, ring in zip(sizes, sigma, widest, circular)
        ]
        terms += (Matrices((amplitude * matrices[0], *matrices[1:])),)
    terms += whole(element.number("amplitudeGlobal", 0.0))
    return mapped(size, terms, ("circular",) * len(sizes))


def _widths(element: Element, name: str, axes: int) -> list[float]:
    widths = element.numbers(name)
    if len(widths) < axes or any(width < 0 for width in widths):
        raise element.error(f"{name}={widths}: give {axes} widths of at least 0, one per axis")
    return widths[:axes]


def _ring(n: int, sigma: float, pad: int, normalized: bool) -> Tensor:
    """A Gaussian around a ring that is longer than the field by ``pad`` sites on both sides."""
    ring = n + 2 * pad
    offset = torch.arange(ring, dtype=torch.float64)
    taps = bell(torch.minimum(offset, ring - offset), sigma)
    taps = taps / taps.sum() if normalized else taps
    sites = torch.arange(n)
    return taps[(sites.unsqueeze(1) - sites) % ring]


def bell(distance: Tensor, sigma: float) -> Tensor:
    """A Gaussian; of width 0 it is 1 where the distance is 0."""
    if sigma == 0:
        return (distance == 0).double()
    return torch.exp(-0.5 * (distance / sigma) ** 2)


def stimulus(element: Element, size: Size) -> Tensor:
    """The pattern of a Gaussian stimulus; its position counts from 1 in the file."""
    pattern = torch.ones((), dtype=torch.float64)
    axes = [k for k, n in enumerate(size) if n > 1]
    for k in axes:
        end = ending(element, k)
        n, sigma = size[k], element.number(f"sigma{end}", least=0.0)
        distance = torch.arange(n, dtype=torch.float64) - (element.number(f"position{end}") - 1)
        if element.flag(f"circular{end}"):
            distance = distance % n
            distance = torch.minimum(distance, n - distance)
        pattern = pattern.unsqueeze(-1) * bell(distance, sigma)
    total = float(pattern.sum())
    if element.flag("normalized", False) and total > 0:
        pattern = pattern / total
    return element.number("amplitude") * pattern


def leaning(element: Element, size: Size) -> Map:
    """The map of a difference of Gaussians on a line whose middle is shifted."""
    n, shift, circular = size[-1], element.number("shift", 0.0), element.flag("circular")
    signed = [element.number("amplitudeExc"), -element.number("amplitudeInh")]
    sigmas = [element.number(f"sigma{end}", least=0.0) for end in ("Exc", "Inh")]
    widest = max(sigma * (a != 0) for sigma, a in zip(sigmas, signed))
    reach = element.number("cutoffFactor", 5.0, least=0.0) * widest
    left = right = min(math.ceil(reach + abs(shift)), n - 1)
    if circular:
        left = min(max(math.ceil(reach - shift), 0), (n - 1) // 2)
        right = min(max(math.ceil(reach + shift), 0), n // 2)
    _check_matrix(element, n)
    offset = torch.arange(-left, right + 1)
    matrix = torch.zeros(n, n, dtype=torch.float64)
    for amplitude, sigma in zip(signed, sigmas):
        taps = bell(offset.double() - shift, sigma)
        if element.flag("normalized") and bool(taps.any()):
            taps = taps / taps.sum()
        for by, tap in zip(offset.tolist(), (amplitude * taps).tolist()):
            line = torch.full((n,), tap, dtype=torch.float64)
            matrix += line.diag().roll(by, 0) if circular else line[abs(by) :].diag(-by)
    terms = (Matrices((matrix,)), *whole(element.number("amplitudeGlobal")))
    return mapped(size, terms, ("circular",) * len(names(size)))


def shifted(element: Element, size: Size) -> Map:
    """The map of a pattern that is moved by whole sites."""
    shift = element.numbers("shiftValue")
    if not 1 <= len(shift) <= len(size):
        raise element.error(f"shiftValue={shift} does not fit size={list(size)}: give one per axis")
    shift = [0.0] * (len(size) - len(shift)) + shift
    if element.number("fillValue", 0.0) != 0:
        raise element.error("fillValue is not 0, which no map can fill in: set it to 0")
    matrices = []
    for n, by in zip(size, shift):
        if n > 1:
            _check_matrix(element, n)
            moved = torch.eye(n, dtype=torch.float64).roll(round(by), 0)
            if not element.flag("circular", False):
                edge = torch.arange(n) < by if by > 0 else torch.arange(n) >= n + by
                moved = moved * ~edge.unsqueeze(1)
            matrices.append(moved)
    term = Matrices(tuple(matrices)) if matrices else Global(1.0)
    gained = mapped(size, (term,), ("circular",) * len(matrices))
    return gained._replace(gain=element.number("amplitude", 1.0))

"""The numbers of a structure that may be turned while it runs."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from torch import Tensor

from dntorch.cells.kernels import Gauss, Global
from dntorch.live.inputs import Peak, recognised
from dntorch.modules.architecture import Architecture
from dntorch.modules.elements import Stimulus
from dntorch.modules.relay import Relay

AXES = ("z", "y", "x")


class Knob(NamedTuple):
    """One number: where it is, how far it may be turned, how it is read and set.

    ``write`` raises what the structure raises, with its sentence, and then changes nothing.
    """

    group: str
    name: str
    low: float
    high: float
    read: Callable[[], float]
    write: Callable[[float], None]


def span_of(name: str, value: float) -> tuple[float, float]:
    """How far a number may be turned: from 0 to three times what it is, and more where signs
    may change."""
    if name == "h":
        return min(-15.0, 2 * value), max(5.0, 2 * value)
    if name.startswith(("tau", "steepness", "sd")):
        return 0.0, max(3 * value, 0.3)
    if name.startswith("threshold"):
        return min(-5.0, 2 * value), max(5.0, 2 * value)
    size = max(3 * abs(value), 1.0)
    return (-size, size) if "amplitude" in name or name == "gain" else (min(0, 3 * value), size)


def part_knobs(group: str, part: Any) -> Iterator[Knob]:
    """Of the parameters of a field, node or trace, and of the terms of its kernel."""
    if isinstance(part, Relay):
        return
    for name in part.numeric():
        value = getattr(part, name, None)
        single = isinstance(value, float) or (isinstance(value, Tensor) and value.numel() == 1)
        if name not in part.fixed and single:
            yield Knob(
                group, name, *span_of(name, float(value)),
                lambda name=name: float(getattr(part, name)),
                lambda value, name=name: setattr(part, name, value),
            )  # fmt: skip
    if hasattr(part, "kernel"):
        yield from kernel_knobs(group, part, part.shape)


def kernel_knobs(group: str, held: Any, shape: list[int]) -> Iterator[Knob]:
    """Of a field or a projection: its gain, or amplitudes and widths of the terms."""
    if isinstance(held.kernel, (float, Tensor)):
        yield _kernel_knob(group, held, "gain", None, "", 0)
        return
    for k, term in enumerate(held.kernel):
        if isinstance(term, Global):
            yield _kernel_knob(group, held, f"Global {k + 1} amplitude", k, "amplitude", 0)
        elif isinstance(term, Gauss):
            yield _kernel_knob(group, held, f"Gauss {k + 1} amplitude", k, "amplitude", 0)
            many = isinstance(term.sigma, (tuple, list))
            for axis in range(len(term.sigma) if many else 1):
                name = f"Gauss {k + 1} sigma" + (f" {axis_name(axis, len(shape))}" if many else "")
                longest = max(shape, default=1) / 4
                knob = _kernel_knob(group, held, name, k, "sigma", axis)
                yield knob._replace(high=max(longest, 2 * knob.read()))


def _kernel_knob(group: str, held: Any, name: str, k: int | None, entry: str, axis: int) -> Knob:
    def read() -> float:
        value = held.kernel if k is None else getattr(held.kernel[k], entry)
        return float(value[axis] if isinstance(value, (tuple, list)) else value)

    def write(value: float) -> None:
        if k is None:
            held.kernel = value
            return
        terms = list(held.kernel)
        before = getattr(terms[k], entry)
        if isinstance(before, (tuple, list)):
            value = (*before[:axis], value, *before[axis + 1 :])
        terms[k] = terms[k]._replace(**{entry: value})
        held.kernel = tuple(terms)

    return Knob(group, name, *span_of(name, read()), read, write)


def peak_knobs(group: str, read: Callable[[], Peak], write: Callable[[Peak], None]) -> list[Knob]:
    """Of an input: position and width on each axis, and amplitude."""
    first = read()
    amplitude = Knob(
        group, "amplitude", *span_of("amplitude", first.amplitude),
        lambda: read().amplitude, lambda value: write(read().changed("amplitude", 0, value)),
    )  # fmt: skip
    knobs, axes = [amplitude], len(first.shape)
    for axis, n in enumerate(first.shape):
        ranges = {"position": (0.0, n - 1.0), "sigma": (0.0, max(n / 4, 2 * first.sigma[axis]))}
        for name, (low, high) in ranges.items():
            label = f"{name} {axis_name(axis, axes)}" if axes > 1 else name
            knobs.append(Knob(
                group, label, low, high,
                lambda name=name, axis=axis: getattr(read(), name)[axis],
                lambda value, name=name, axis=axis: write(read().changed(name, axis, value)),
            ))  # fmt: skip
    return knobs


def axis_name(axis: int, axes: int) -> str:
    return AXES[axis - axes] if axes <= len(AXES) else str(axis)


def architecture_knobs(architecture: Architecture) -> Iterator[Knob]:
    """Of all elements, links and stimuli of an architecture."""
    for element in architecture.elements.values():
        if not element.passing:
            yield from part_knobs(element.label, element.part)
    count: dict[str, int] = {}
    for source, target, projection, *_ in architecture.links:
        group = f"{source} -> {target}"
        count[group] = count.get(group, 0) + 1
        again = f" ({count[group]})" if count[group] > 1 else ""
        yield from kernel_knobs(group + again, projection, projection.shape)
    for stimulus in architecture.stimuli.values():
        yield from stimulus_knobs(stimulus)


def stimulus_knobs(stimulus: Stimulus) -> list[Knob]:
    """Of a constant stimulus: of the peak that it is, or a gain; none where it is silent."""
    first, held = stimulus.value.clone(), {"peak": recognised(stimulus.value), "gain": 1.0}
    if not bool(first.any()):
        return []

    def put(peak: Peak) -> None:
        value = peak.tensor()  # may refuse
        stimulus.value.copy_(value)
        held["peak"] = peak

    def scale(gain: float) -> None:
        stimulus.value.copy_(gain * first)
        held["gain"] = gain

    if held["peak"] is not None:
        return peak_knobs(stimulus.label, lambda: held["peak"], put)
    return [Knob(stimulus.label, "gain", -3.0, 3.0, lambda: held["gain"], scale)]

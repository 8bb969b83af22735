"""What each class of COSIVINA's elements computes."""

import math

import torch

from dntorch.cells.kernels import Gauss, Matrices
from dntorch.cosivina.files import Element, Size
from dntorch.cosivina.kernels import fourier, gaussians, leaning, mapped, shifted, stimulus, whole
from dntorch.cosivina.parts import AXES, Map, Part, names, repeat, shape

Parts = dict[str, Part]
"""The components of an element."""

TICK = 1e-3
"""Seconds in COSIVINA's unit of time."""


def field(element: Element, delta_t: float) -> Parts:
    """``u += deltaT / tau * (-u + h + inputs)``, with a logistic output."""
    size, h = element.size(), element.number("h")
    options = {
        "tau": element.positive("tau") * TICK,
        "h": h,
        "steepness": element.number("beta"),
    }
    if delta_t * TICK > options["tau"]:
        raise element.error(
            f"tau={element.number('tau'):g} is shorter than deltaT={delta_t:g}, so that a step "
            "would overshoot: take a smaller deltaT"
        )
    level = torch.tensor(h, dtype=torch.float64)
    member = Part("field", size, options=options)
    return {"output": member, "activation": member, "h": Part("constant", (1, 1), value=level)}


def trace(element: Element, delta_t: float) -> Parts:
    """A share of 1 / tau of the way in each step, however long it is."""
    options: dict[str, float] = {"threshold": element.number("threshold", 0.5)}
    for ours, name in (("tau_build", "tauBuild"), ("tau_decay", "tauDecay")):
        options[ours] = seconds(element.number(name, least=1.0), delta_t * TICK)
    return {"output": Part("trace", element.size(), options=options)}


def seconds(steps: float, dt: float) -> float:
    """The time constant with which an exact step of ``dt`` goes 1 / ``steps`` of the way."""
    return -dt / math.log1p(-1 / steps) if steps > 1 else dt / 64


def kernel(element: Element, delta_t: float) -> Parts:
    """A Gaussian."""
    return _kernel(element, ("",), False)


def hat(element: Element, delta_t: float) -> Parts:
    """A difference of Gaussians, and perhaps a global term; sums of the input beside it."""
    return _kernel(element, ("Exc", "Inh"), True)


def _kernel(element: Element, suffixes: tuple[str, ...], shared: bool) -> Parts:
    size = element.size()
    if element.kind.endswith("1D") and (len(size) > 2 or size[0] > 1):
        raise element.error(f"size={list(size)} is no line: give [1, n]")
    output = Part("map", size, gaussians(element, size, suffixes, shared), size)
    return {"output": output, **_sums(size)}


def hat_shifted(element: Element, delta_t: float) -> Parts:
    """A difference of Gaussians whose middle is shifted, and a global term."""
    size = element.size()
    output = Part("map", size, leaning(element, size), size)
    return {"output": output, "fullSum": _sums(size)["fullSum"]}


def fft(element: Element, delta_t: float) -> Parts:
    """A difference of Gaussians and a global term, without cutoff."""
    size = element.size()
    axes = len(shape(size))
    circular = [x != 0 for x in element.numbers("circular", [1] * axes)]
    if len(circular) < axes:
        raise element.error(f"circular={circular}: give {axes} flags, one per axis")
    padding = element.number("paddingFactor", 5.0, least=0.0)
    return {"output": Part("map", size, fourier(element, size, circular[:axes], padding), size)}


def inverse_fft(element: Element, delta_t: float) -> Parts:
    """The kernel of `fft`, of an input that went through the forward transform before."""
    return fft(element._replace(parameters={**element.parameters, "circular": [1, 1, 1, 1]}), 0)


def discrete(element: Element, delta_t: float) -> Parts:
    """Each node on itself, and all on all."""
    size, amplitude = element.size(), element.number("amplitudeExc")
    terms: tuple = (Gauss(amplitude, 0.0),) if amplitude != 0 else ()
    terms += whole(element.number("amplitudeGlobal"))
    border = ("circular",) * len(shape(size))
    return {"output": Part("map", size, mapped(size, terms, border), size)}


def moved(element: Element, delta_t: float) -> Parts:
    """Whole sites to the right and down."""
    size = element.size()
    return {"output": Part("map", size, shifted(element, size), size)}


def _sums(size: Size) -> Parts:
    """Sums over columns, over rows, over all; each is a line."""
    whole = Part("map", (1, 1), Map(names(size), ()), size)
    if len(size) > 2:
        return {"fullSum": whole}
    vertical = Map(names(size), names((1, size[1])))
    horizontal = Map(names(size), names((size[0], 1)))
    return {
        "fullSum": whole,
        "verticalSum": Part("map", (1, size[1]), vertical, size),
        "horizontalSum": Part("map", (1, size[0]), horizontal, size),
    }


def sums(element: Element, delta_t: float) -> Parts:
    """Sums over columns, over rows, over all."""
    return _sums(element.size())


def sum_over(element: Element, delta_t: float) -> Parts:
    """Over chosen axes, times a gain; those that are left may change places."""
    size = element.size()
    options = {
        "over": element.wholes("sumDimensions"),
        "order": element.wholes("dimensionOrder", list(range(1, len(size) + 1))),
        "gain": element.number("amplitude", 1.0),
    }
    return {"output": Part("sums", size, options=options)}


def expand(element: Element, delta_t: float) -> Parts:
    """A line along each row (1), or each column (2), of a plane."""
    size, along = element.size(), element.number("expandDimension")
    if along not in (1, 2) or len(size) != 2:
        raise element.error(
            f"expandDimension={along:g}, size={list(size)}: give 1 or 2, and a plane"
        )
    line = (1, size[1]) if along == 1 else (size[0], 1)
    return {"output": Part("map", size, repeat(line, size), line)}


def expand_any(element: Element, delta_t: float) -> Parts:
    """Axis k of the input becomes axis ``dimensionMapping(k)`` of the output."""
    size, into = element.size("inputSize"), element.size("outputSize")
    where = element.wholes("dimensionMapping")
    sizes = size[-1:] if len(where) == 1 else size
    fits = len(where) == len(sizes) and all(1 <= k <= len(into) for k in where)
    if not fits or any(n not in (1, into[k - 1]) for n, k in zip(sizes, where)):
        raise element.error(
            f"dimensionMapping={where} does not fit {list(size)} and {list(into)}: give for each "
            "axis of the input one of the output"
        )
    came = tuple(AXES[k - 1] for n, k in zip(sizes, where) if n > 1)
    return {"output": Part("map", into, Map(came, names(into)), size)}


def _plane(element: Element) -> Size:
    """A size of two axes."""
    size = element.size()
    if len(size) != 2:
        raise element.error(f"size={list(size)} is no plane: give two numbers")
    return size


def transpose(element: Element, delta_t: float) -> Parts:
    """Rows become columns."""
    size = _plane(element)
    before = size[::-1]
    turned = Map(names(before), tuple("yx"["xy".index(name)] for name in names(size)))
    return {"output": Part("map", size, turned, before)}


def diagonal_sum(element: Element, delta_t: float) -> Parts:
    """A square over its diagonals: row + column is the site."""
    n = element.size("inputSize")[-1]
    turned = Map(("y", "x"), ("y+x",), element.number("amplitude"))
    return {"output": Part("map", (1, 2 * n - 1), turned, (n, n))}


def diagonal_expansion(element: Element, delta_t: float) -> Parts:
    """A line along the diagonals of a square; COSIVINA does not use the amplitude."""
    line = element.size("inputSize")
    n = (line[-1] + 1) // 2
    return {"output": Part("map", (n, n), Map(("y+x",), ("y", "x")), line)}


def weights(element: Element, delta_t: float) -> Parts:
    """A row times a matrix ``(from, to)``."""
    came, goes = _plane(element)
    flat = element.numbers("weights")
    if len(flat) != came * goes or came == 1:
        raise element.error(
            f"{len(flat)} weights do not fit size={[came, goes]}: give a matrix from at least 2 "
            "sites to all sites of the output"
        )
    matrix = torch.tensor(flat, dtype=torch.float64).reshape(came, goes).t()
    kernel = Map(("x",), ("x",), 1.0, (Matrices((matrix,)),), ("zero",))
    return {"output": Part("map", (1, goes), kernel, (1, came))}


def scaled(element: Element, delta_t: float) -> Parts:
    """The first input times a gain."""
    options = {"gain": element.number("amplitude")}
    return {"output": Part("first", element.size(), options=options)}


def added(element: Element, delta_t: float) -> Parts:
    """The sum of all inputs."""
    return {"output": Part("sum", element.size())}


def multiplied(element: Element, delta_t: float) -> Parts:
    """The product of the first two inputs."""
    return {"output": Part("product", element.size())}


def logistic(element: Element, delta_t: float) -> Parts:
    """A logistic sigmoid of the first input."""
    beta, threshold = element.number("beta"), element.number("threshold", 0.0)
    options = {"kind": "logistic", "steepness": beta, "threshold": threshold}
    return {"output": Part("first", element.size(), options=options)}


def rectified(element: Element, delta_t: float) -> Parts:
    """Zero below zero."""
    options = {"kind": "semilinear", "steepness": 1.0, "threshold": 0.0}
    return {"output": Part("first", element.size(), options=options)}


def passed(element: Element, delta_t: float) -> Parts:
    """Forward transform: the backward one, which alone can read it, undoes it."""
    return {"output": Part("first", element.size())}


def bump(element: Element, delta_t: float) -> Parts:
    """A Gaussian that acts all the time."""
    size = element.size()
    return {"output": Part("constant", size, value=stimulus(element, size))}


def boost(element: Element, delta_t: float) -> Parts:
    """A number that acts all the time."""
    value = torch.tensor(element.number("amplitude"), dtype=torch.float64)
    return {"output": Part("constant", (1, 1), value=value)}


def pattern(element: Element, delta_t: float) -> Parts:
    """A pattern that acts all the time."""
    size, flat = element.size(), element.numbers("pattern")
    if len(flat) != math.prod(size):
        raise element.error(f"pattern of {len(flat)} numbers does not fit size={list(size)}")
    value = torch.tensor(flat, dtype=torch.float64).reshape(shape(size))
    return {"output": Part("constant", size, value=value)}


def noise(element: Element, delta_t: float) -> Parts:
    """White noise that the caller draws with sd 1; it is scaled here."""
    gain = element.number("amplitude") / math.sqrt(delta_t)
    return {"output": Part("open", element.size(), options={"gain": gain})}

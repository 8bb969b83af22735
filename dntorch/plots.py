"""Figures of fields: one function each, which draws into ``ax`` and returns it.

Without ``ax`` they make a figure of their own, ``plots.kernel(field).figure.savefig("k.png")``,
without pyplot: nothing global keeps it alive, and no window opens. Positions are in sites and
count from 0. Matplotlib comes with ``pip install 'dntorch[cli]'``; this module can be imported
without it.
"""

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from dntorch.analysis import as_inputs, equation, fixed_points
from dntorch.cells.field import lateral
from dntorch.cells.kernels import assemble
from dntorch.cells.readout import Border, field_of
from dntorch.cells.readout import peaks as find_peaks
from dntorch.checks import check_finite_number, check_no_nan, check_positive, check_real
from dntorch.extras import require
from dntorch.modules.field import DNF
from dntorch.modules.node import NodeWTA

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, LINE = "#30363d", "#2f6fde"


def space_time(
    field: Tensor, dt: float, ax: "Axes | None" = None, label: str = "activation u"
) -> "Axes":
    """A line over time: time to the right in seconds, position upwards, values as colours.

    Negative values are blue and positive ones red, white is zero; without negative ones, from
    white to black.

    Args:
        field: activation or output, ``(time, n)``, as `dntorch.rollout` returns it.
        dt: seconds per step.
        label: what the colours are.

    Raises:
        TypeError: ``field`` is no tensor of floats.
        ValueError: not two dimensions, NaN, ``dt`` not positive.
        ImportError: Matplotlib is missing.
    """
    values = _shown("field", field, 2, "(time, n): one line, or the maximum over the other axes")
    check_finite_number("dt", dt)
    check_positive("dt", dt, "give seconds per step")
    ax = _axes(ax, (8, 3.6))
    steps, n = values.shape
    _image(ax, values.T, (0.0, steps * dt, -0.5, n - 0.5), label, "auto")
    ax.set(xlabel="time (s)", ylabel="position (sites)")
    return ax


def peaks(
    u: Tensor, threshold: float = 0.0, border: Border = "circular", ax: "Axes | None" = None
) -> "Axes":
    """A field and its peaks: a line with its threshold, or a sheet as an image.

    Marked are the centres of mass that `dntorch.peaks` finds; on a line the marker stands on the
    curve.

    Args:
        u: activation ``(n,)`` with one border, ``(y, x)`` with two, or an output.
        threshold: a site is on above it.
        border: as for `dntorch.peaks`.

    Raises:
        TypeError, ValueError: as `dntorch.peaks`; a batch, or three axes.
        ImportError: Matplotlib is missing.
    """
    _, shape = field_of("u", u, border)
    if len(shape) > 2 or u.dim() != len(shape):
        raise ValueError(
            f"u of shape {list(u.shape)} is no single line or sheet of {len(shape)} axes: give one "
            "field, and a border per axis"
        )
    u = u.float() if u.dtype == torch.bfloat16 else u  # which NumPy does not know
    found, values = find_peaks(u, threshold, border), u.detach().cpu()
    center = found.center.detach().cpu()
    ax = _axes(ax, (6, 3.6))
    look = {
        "linestyle": "none",
        "markeredgecolor": "white",
        "marker": "o",
        "color": INK,
        "label": "centres of peaks",
    }
    if len(shape) == 1:
        sites = torch.arange(shape[0])
        ax.plot(sites.numpy(), values.numpy(), color=LINE, label="field")
        ax.axhline(threshold, color=INK, lw=1, ls="--", label="threshold")
        here = center.squeeze(-1)
        left = here.nan_to_num().floor().long() % shape[0]
        height = torch.lerp(values[left], values[(left + 1) % shape[0]], here % 1)
        ax.plot(here.numpy(), height.numpy(), **look)
        ax.set(xlabel="position (sites)", ylabel="activation u")
    else:
        _image(ax, values, (-0.5, shape[1] - 0.5, -0.5, shape[0] - 0.5), "activation u")
        ax.plot(center[:, 1].numpy(), center[:, 0].numpy(), **look)
        ax.set(xlabel="x (sites)", ylabel="y (sites)")
    return ax


def kernel(field: DNF, ax: "Axes | None" = None) -> "Axes":
    """The effect of a site in the middle of a field on all sites, over their distance from it.

    What excites is above zero, or red; what inhibits below, or blue. With zero borders, too,
    this is what every site far from the edges does.

    Raises:
        TypeError: ``field`` is no `dntorch.DNF`.
        ValueError: a field of no or three axes.
        ImportError: Matplotlib is missing.
    """
    if not isinstance(field, DNF):
        raise TypeError(f"field is a {type(field).__name__}: give a DNF")
    shape = field.shape
    if len(shape) not in (1, 2):
        raise ValueError(f"field of shape={shape} has {len(shape)} axes: give one of 1 or 2")
    matrices, everywhere = assemble(field.kernel, shape, field.border)
    middle = [n // 2 for n in shape]
    impulse = torch.zeros(shape, dtype=torch.float64)
    impulse[tuple(middle)] = 1.0
    effect = lateral(impulse, [m.detach().cpu() for m in matrices], float(everywhere))
    ax = _axes(ax, (6, 3.6))
    if len(shape) == 1:
        ax.axhline(0, color=INK, lw=1)
        ax.plot((torch.arange(shape[0]) - middle[0]).numpy(), effect.numpy(), color=LINE)
        ax.set(xlabel="distance (sites)", ylabel="weight")
    else:
        (y, x), (ny, nx) = middle, shape
        _image(ax, effect, (-0.5 - x, nx - 0.5 - x, -0.5 - y, ny - 0.5 - y), "weight")
        ax.set(xlabel="distance along x (sites)", ylabel="distance along y (sites)")
    return ax


def phase(node: DNF | NodeWTA, input: float | Tensor = 0.0, ax: "Axes | None" = None) -> "Axes":
    """Rate of change of a node over its activation, with its fixed points.

    Full markers are stable, open ones are not; where the curve is above zero, the activation
    grows. One curve per input.

    Args:
        node: a field without axes or one node, as for `dntorch.fixed_points`.
        input: a number, or numbers ``(k,)``.

    Raises:
        TypeError, ValueError: as `dntorch.fixed_points`.
        ImportError: Matplotlib is missing.
    """
    inputs = torch.atleast_1d(as_inputs(input))
    points = fixed_points(node, inputs)
    one, ends = equation(node), [u for each in points for u, _ in each]
    low, high = min([*ends, one.threshold]), max([*ends, one.threshold])
    room = 0.15 * (high - low) + 0.5
    low = low - room if one.floor is None else max(low - room, one.floor)
    u = torch.linspace(low, high + room, 1001, dtype=torch.float64)
    ax = _axes(ax, (6, 3.6))
    ax.axhline(0, color=INK, lw=1)
    for each, found in zip(inputs, points, strict=True):
        (line,) = ax.plot(u.numpy(), one.rate(each, u).numpy(), label=f"input {each.item():g}")
        for stable in (True, False):
            there = [point.u for point in found if point.stable == stable]
            look = {"markerfacecolor": line.get_color() if stable else "white", "zorder": 3}
            style = {"marker": "o", "linestyle": "none", "color": line.get_color()}
            name = "stable" if stable else "unstable"
            ax.plot(there, [0.0] * len(there), **style, **look, gid=name)
    ax.set(xlabel="activation u", ylabel="du/dt (1/s)")
    ax.legend(frameon=False)
    return ax


def _axes(ax: "Axes | None", size: tuple[float, float]) -> "Axes":
    require("matplotlib")
    if ax is not None:
        if not hasattr(ax, "imshow"):
            raise TypeError(f"ax is a {type(ax).__name__}: give Axes of Matplotlib, or None")
        return ax
    from matplotlib.figure import Figure

    ax = Figure(size, layout="constrained").subplots()
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _image(
    ax: "Axes",
    values: Tensor,
    extent: tuple[float, float, float, float],
    label: str,
    aspect: str = "equal",
) -> None:
    """Rows upwards; colours symmetrical around zero where there are negative values."""
    low, high = (float(end) for end in values.aminmax())
    most = max(abs(low), abs(high)) or 1.0
    colors = {"cmap": "RdBu_r", "vmin": -most} if low < 0 else {"cmap": "Greys", "vmin": 0.0}
    look = {"origin": "lower", "aspect": aspect, "interpolation": "nearest"}
    image = ax.imshow(values.numpy(), extent=extent, vmax=most, **colors, **look)
    ax.figure.colorbar(image, ax=ax, label=label)


def _shown(name: str, tensor: Tensor, dims: int, form: str) -> Tensor:
    """A tensor of so many dimensions, ready to be drawn; or raise."""
    check_real(name, tensor)
    check_no_nan(name, tensor)
    if tensor.dim() != dims or not tensor.numel():
        raise ValueError(f"{name} of shape {list(tensor.shape)} can't be drawn: give {form}")
    return (
        tensor.detach().cpu().float() if tensor.dtype == torch.bfloat16 else tensor.detach().cpu()
    )

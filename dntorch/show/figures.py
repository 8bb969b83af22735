"""Figures of a run, as in the paper: events out of neural dynamics, reward, error, values.

Source: Figs. 2 and 3 of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
Reinforcement of Behavioral Sequences in Neural Dynamics".

Figures are made without pyplot: nothing global keeps them alive.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dntorch.cells.functions import is_on
from dntorch.runs.config import Config
from dntorch.runs.record import Record
from dntorch.runs.train import names_of_states
from dntorch.show.extracts import (
    SMOOTH,
    chunk,
    mean_errors,
    running_mean,
    strongest,
    value_image,
)

#: How a colour of the world is drawn on white: the same hue, easier on the eye.
PAINT: dict[str, str] = {
    "R": "#e5484d", "O": "#f0883e", "Y": "#e2b007", "G": "#30a46c",
    "C": "#12a5b8", "B": "#2f6fde", "V": "#7c5cd6", "M": "#d6409f",
}  # fmt: skip
INK, FAINT, SHADE = "#30363d", "#b4bcc6", "#f2f4f7"


def dynamics(record: Record, config: Config) -> Figure:
    """Intention and CoS nodes and the behaviours they make: exploration, then exploitation."""
    figure = Figure((11, 5.6), layout="constrained")
    axes = figure.subplots(3, 2, sharex="col", sharey="row", height_ratios=(3, 3, 1))
    phases = {"Exploration": (0, config.explore), "Exploitation": (config.explore, config.steps)}
    for k, (title, phase) in enumerate(phases.items()):
        steps, (*nodes, bars) = chunk(record, *phase), axes[:, k]
        seconds = np.arange(steps.start, steps.stop) * config.dt
        for color, letter in enumerate(config.colors):
            _rate(nodes[0], seconds, record.intention[steps, color], PAINT[letter])
            _rate(nodes[1], seconds, record.satisfaction[steps, color], PAINT[letter])
        _bars(bars, record, steps, config)
        title = title if len(seconds) else f"{title}: none"
        nodes[0].set_title(title, loc="left", color=INK, fontweight="bold", size=12)
        bars.set_xlim(steps.start * config.dt, max(steps.stop, steps.start + 1) * config.dt)
        bars.set_xlabel("time (s)")
    for ax, label in zip(axes[:, 0], ("intention nodes", "CoS nodes", "behaviour")):
        ax.set_ylabel(label)
    _tidy(*axes.flat)
    return figure


def reward(record: Record, config: Config) -> Figure:
    """Completed sequences against time, with the end of exploration."""
    figure = Figure((9, 4), layout="constrained")
    ax = figure.subplots()
    steps = np.concatenate(([0], record.rewards, [record.length]))
    total = np.arange(len(steps)).clip(max=len(record.rewards))
    ax.fill_between(steps, total, step="post", color=PAINT["G"], alpha=0.15, lw=0)
    ax.step(steps, total, where="post", color=PAINT["G"], lw=2)
    ax.plot(steps[1:-1], total[1:-1], "o", ms=3, color=PAINT["G"])
    ax.set(ylim=(0, 1.15 * max(1, total[-1])), ylabel=f"completed sequences {config.sequence}")
    ax.yaxis.get_major_locator().set_params(integer=True)
    _phases(ax, record, config)
    return figure


def td_error(record: Record, config: Config) -> Figure:
    """The value cell, and its mean size in each transition between behaviours."""
    figure = Figure((9, 5), layout="constrained")
    cell, mean = figure.subplots(2, 1, sharex=True)
    cell.plot(record.error[: record.length], color=PAINT["B"], lw=0.6)
    cell.set_ylabel("value cell v")
    ends, sizes = mean_errors(record)
    mean.plot(ends, sizes, ".", ms=3, color=FAINT, label="one transition")
    mean.plot(ends, running_mean(sizes), color=PAINT["R"], lw=2, label=f"mean of {SMOOTH}")
    mean.set_ylabel("mean |v|")
    mean.legend(frameon=False, fontsize=9, labelcolor=INK, loc="upper left")
    for ax in (cell, mean):
        _phases(ax, record, config)
    cell.set_xlabel("")
    return figure


def trace(record: Record, config: Config) -> Figure:
    """Item-and-order memory over a chunk, and the gradient that it holds at its last reward."""
    figure = Figure((11, 4.4), layout="constrained")
    ax, order = figure.subplots(1, 2, width_ratios=(4, 1))
    first = config.explore if record.length > config.explore else 0
    steps = chunk(record, first, record.length)
    rewards = record.rewards[(record.rewards >= steps.start) & (record.rewards < steps.stop)]
    for step in rewards:
        ax.axvline(step * config.dt, color=INK, lw=1, ls=":", label="reward")
    seconds = np.arange(steps.start, steps.stop) * config.dt
    _pairs(ax, seconds, record.trace[steps], config)
    high = 1.3 * max(0.05, record.trace[steps].max(initial=0))
    ax.set(ylim=(0, high), xlabel="time (s)", ylabel="activity of pairs state → action")
    now = record.trace[rewards[-1] if len(rewards) else max(record.length - 1, 0)]
    for pair in strongest(now[None], 6)[::-1]:
        color, label = _style(pair, config)
        order.barh(label, now[pair], color=color)
    order.set(title="at the last reward" if len(rewards) else "at the end", xlabel="activity")
    _tidy(ax, order)
    return figure


def values(record: Record, config: Config) -> Figure:
    """Value matrix as in the paper's film: state down, action across, white is high."""
    weights, colors = record.arrays()["weights"], config.colors
    shown = value_image(weights[-1] if len(weights) else record.weights[0])
    states = names_of_states(config)
    size = 2.2 + 0.62 * len(colors)
    figure = Figure((size + 1, 2.2 + min(0.62 * len(states), 40)), layout="constrained")
    ax = figure.subplots()
    low, high = min(0.0, float(shown.min())), max(0.0, float(shown.max()))
    image = ax.imshow(shown, cmap="gray", vmin=low, vmax=high if high > low else 1)
    for (state, action), value in np.ndenumerate(shown):
        ink = "black" if value - low > 0.5 * (high - low) > 0 else "white"
        text = f"{round(float(value), 2) + 0.0:.2f}"  # no minus zero
        ax.text(action, state, text, ha="center", va="center", color=ink, fontsize=9)
        if states[state] + colors[action] in config.sequence:
            corner = (action - 0.45, state - 0.45)
            ax.add_patch(Rectangle(corner, 0.9, 0.9, fill=False, ec=PAINT["O"], lw=2))
    ax.set_xticks(range(len(colors)), colors)
    ax.set_yticks(range(len(states)), states)
    for label in ax.get_xticklabels() + ax.get_yticklabels():
        label.set(color=PAINT[label.get_text()[-1]], fontweight="bold", fontsize=13)
    ax.set(xlabel="action: next intention", ylabel="state: last CoS")
    ax.tick_params(length=0)
    figure.colorbar(image, ax=ax, shrink=0.8).outline.set_visible(False)
    return figure


def values_over_time(record: Record, config: Config) -> Figure:
    """How the values of the strongest pairs grew."""
    figure, weights = Figure((9, 4), layout="constrained"), record.arrays()["weights"]
    ax = figure.subplots()
    _pairs(ax, np.arange(len(weights)) * record.SPARSE, weights, config)
    ax.set_ylabel("value of state → action")
    _phases(ax, record, config)
    return figure


FIGURES = (dynamics, reward, td_error, trace, values, values_over_time)


def write_figures(record: Record, config: Config, folder: Path) -> list[Path]:
    """Draw all `FIGURES` of a run, finished or not, as ``<name>.png`` in ``folder``."""
    paths = [Path(folder) / f"{draw.__name__}.png" for draw in FIGURES]
    for draw, path in zip(FIGURES, paths):
        draw(record, config).savefig(path, dpi=140)
    return paths


def _tidy(*axes: Axes) -> None:
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.spines[["left", "bottom"]].set_color(FAINT)
        ax.tick_params(colors=INK, labelsize=9)
        for text in (ax.title, ax.xaxis.label, ax.yaxis.label):
            text.set(color=INK, size=10)


def _phases(ax: Axes, record: Record, config: Config) -> None:
    """An axis of control steps, shaded while the run explored."""
    end = max(record.length, 1)
    explored = min(config.explore, end)
    ax.axvspan(0, explored, color=SHADE, lw=0, zorder=0)
    if 0 < explored < end:
        ax.axvline(explored, color=INK, lw=1, ls="--")
    for title, first, last in (("exploration", 0, explored), ("exploitation", explored, end)):
        if last - first > 0.15 * end:
            place = {"xy": ((first + last) / 2, 1.01), "xycoords": ax.get_xaxis_transform()}
            ax.annotate(title, **place, ha="center", va="bottom", color=INK, size=9, alpha=0.7)
    ax.set_xlim(0, end)
    ax.xaxis.set_major_formatter(lambda x, _: f"{x:,.0f}".replace(",", " "))
    ax.set_xlabel(f"time (control steps of {config.dt * 1000:.4g} ms)")
    _tidy(ax)


def _rate(ax: Axes, seconds: np.ndarray, rate: np.ndarray, color: str) -> None:
    ax.fill_between(seconds, rate, color=color, alpha=0.15, lw=0)
    ax.plot(seconds, rate, color=color, lw=1.6)
    ax.set(ylim=(0, 1.08), yticks=(0, 0.5, 1))


def _bars(ax: Axes, record: Record, steps: slice, config: Config) -> None:
    """What the intention nodes wanted, a bar each time; a star where that was rewarded."""
    for letter, rate in zip(config.colors, record.intention[steps].T):
        edges = np.flatnonzero(np.diff(is_on(rate), prepend=False, append=False))
        for begin, end in (steps.start + edges.reshape(-1, 2)) * config.dt:
            ax.add_patch(Rectangle((begin, 0), end - begin, 1, color=PAINT[letter], lw=0))
            if end - begin > 0.02 * (steps.stop - steps.start) * config.dt:
                middle = {"x": (begin + end) / 2, "y": 0.47, "ha": "center", "va": "center"}
                ax.text(s=letter, **middle, color="white", fontweight="bold", clip_on=True)
    rewards = record.rewards * config.dt
    ax.plot(rewards, np.full(len(rewards), 1.28), "*", color=PAINT["Y"], ms=11, mec=INK, mew=0.5)
    ax.set(ylim=(0, 1.6), yticks=())


def _pairs(ax: Axes, time: np.ndarray, pairs: np.ndarray, config: Config) -> None:
    """One line for each pair, the strongest in the colour of their action, and a legend."""
    ax.plot(time, pairs.reshape(len(pairs), pairs[0:1].size or 1), color=FAINT, lw=0.5)
    for pair in strongest(pairs):
        color, label = _style(pair, config)
        ax.plot(time, pairs[(slice(None), *pair)], lw=2, color=color, label=label)
    unique = dict(zip(*ax.get_legend_handles_labels()[::-1]))
    look = {"frameon": False, "fontsize": 9, "labelcolor": INK, "ncols": 5}
    ax.legend(unique.values(), unique, loc="upper left", **look)


def _style(pair: tuple[int, int], config: Config) -> tuple[str, str]:
    """Colour of the action and the name ``state → action``."""
    action, state = config.colors[pair[0]], names_of_states(config)[pair[1]]
    return PAINT[action], f"{state} → {action}"

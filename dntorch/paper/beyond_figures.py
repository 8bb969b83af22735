"""Figures of the agent beyond the paper, one per section."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dntorch.paper.beyond import Row

#: What the bars of a section are, and how it is called.
BARS = {
    "autonomous": ("optimal", "share optimal at the end"),
    "recall": ("optimal", "share optimal at the end"),
    "change": ("optimal", "share optimal with the second sequence"),
    "missing": ("behaviors", "behaviours completed"),
    "constraints": ("failures", "failures of a run"),
}


def draw(section: str, rows: dict[str, Row]) -> Figure:
    """How many found it after how many behaviours, or a bar a line."""
    figure = Figure((8, 0.8 + 0.42 * max(len(rows), 6)), layout="constrained")
    ax = figure.subplots()
    ax.spines[["top", "right"]].set_visible(False)
    if section in BARS:
        _bars(ax, rows, *BARS[section])
    else:
        _found(ax, section, rows)
    return figure


def _bars(ax: Axes, rows: dict[str, Row], key: str, label: str) -> None:
    for k, (name, row) in enumerate(rows.items()):
        value = row[key]
        share = value[0] / value[1] if isinstance(value, list) else value
        ax.barh(k, share, color="#2f6fde", alpha=0.8)
        if isinstance(value, list):
            low, high = row[f"{key}_interval"]
            ax.plot([low, high], [k, k], color="#30363d", lw=1.5)
        if "discrete" in row and isinstance(value, list):
            twin = row["discrete"][key]
            ax.plot(twin[0] / twin[1], k, "o", color="#e5484d", label="discrete SARSA(λ)")
        ax.text(0, k, f" {name}", va="center", color="white" if share else "#30363d", fontsize=9)
    ax.set(yticks=[], xlabel=label)
    ax.invert_yaxis()
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        ax.legend(handles[:1], labels[:1], frameon=False, fontsize=8, loc="lower right")


def _found(ax: Axes, section: str, rows: dict[str, Row]) -> None:
    for name, row in rows.items():
        first = np.sort([k for k in row["first"] if k > 0])
        share = np.arange(1, len(first) + 1) / len(row["first"])
        ax.step(first, share, where="post", label=name, lw=2 if name == "order 4" else 1.2)
    n, length = (6, 5) if section == "lamp" else (4, 5)
    count = n * (n - 1) ** (length - 1)
    last = max(max(row["first"]) for row in rows.values())
    x = np.arange(max(last, 2))
    chance = "chance in theory" if section == "lamp" else "no explorer can be better"
    limit = 1 - (1 - 1 / count) ** x if section == "lamp" else np.minimum(x / count, 1)
    ax.plot(x, limit, color="#30363d", ls="--", lw=1, label=chance)
    ax.set(xlabel="behaviours", ylabel="share that found the sequence", ylim=(0, 1.02))
    ax.legend(frameon=False, fontsize=8)

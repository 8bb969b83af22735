"""Figures of many runs: those of the paper's results, with spreads, and what is beyond them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dntorch.paper.law import transitions
from dntorch.paper.study import BINS, Study
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.record import Record
from dntorch.runs.run import Run
from dntorch.runs.worlds import WORLDS
from dntorch.show.figures import FAINT, INK, PAINT, SHADE, dynamics

BLUE, GREEN, RED = PAINT["B"], PAINT["G"], PAINT["R"]


def draw(study: Study, folder: Path) -> list[str]:
    """Write all figures as PNG into ``folder``; returns their names without the ending."""
    figures = {
        "results": results(study),
        "learning_law": learning_law(study),
        "exploration": exploration(study),
    }
    chosen = example_run(study)
    if chosen is not None:
        figures["dynamics"] = dynamics(*example(study, chosen, folder))
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=110, facecolor="white")
    return list(figures)


def example_run(study: Study) -> int | None:
    """A run that found the sequence late and twice while it explored, as the paper's run 6."""
    column = np.arange(study.runs.rewarded.shape[1])
    early = study.runs.rewarded & (column < study.explored[:, None])
    twice = study.success.optimal & (early.sum(1) >= 2)
    pool = np.flatnonzero(twice if twice.any() else study.success.found)
    if len(pool) == 0:
        return None
    first = study.runs.steps[pool, study.success.first[pool]]
    return int(pool[np.argmin(abs(first - 0.6 * study.config.explore))])


def results(study: Study) -> Figure:
    """Panels (b) to (e) of the paper's figure of results."""
    figure = Figure(figsize=(12, 7.2), layout="constrained")
    b, c, d, e = figure.subplots(2, 2).flat
    _cumulative(b, study)
    _times(c, study)
    _errors(d, study)
    _example(e, study)
    for ax, title in ((b, "(b) cumulative reward"), (c, "(c) time to find and to learn"),
                      (d, "(d) TD error"), (e, "(e) one run")):  # fmt: skip
        ax.set_title(title, loc="left", color=INK, fontweight="bold")
        tidy(ax)
    return figure


def reward_steps(study: Study, run: int) -> np.ndarray:
    return study.runs.steps[run][study.runs.rewarded[run]]


def _phase(ax: Axes, study: Study) -> None:
    ax.axvspan(0, study.config.explore, color=SHADE, zorder=0)
    ax.set_xlim(0, study.config.steps)
    ax.set_xlabel("control steps (32 a second); shaded: exploration")


def _cumulative(ax: Axes, study: Study) -> None:
    grid = np.linspace(0, study.config.steps, 401)
    count = len(study.total)
    curves = np.stack([np.searchsorted(reward_steps(study, r), grid) for r in range(count)])
    for share, alpha in ((90, 0.12), (50, 0.25)):
        low, high = np.percentile(curves, [50 - share / 2, 50 + share / 2], axis=0)
        ax.fill_between(grid, low, high, color=GREEN, alpha=alpha, lw=0, label=f"{share} % of runs")
    ax.plot(grid, curves.mean(0), color=GREEN, lw=2, label=f"mean of {count}")
    if study.success.found.any():
        mean = curves[study.success.found].mean(0)
        ax.plot(grid, mean, color=INK, lw=1.2, ls="--", label="mean of those that found it")
    ax.set_ylabel("rewards")
    ax.legend(frameon=False, fontsize=8)
    _phase(ax, study)


def _times(ax: Axes, study: Study) -> None:
    found = np.flatnonzero(study.success.found & (study.success.needed > 0))
    if len(found) == 0:
        return
    each, steps = study.success, study.runs.steps
    first = steps[found, each.first[found]]
    last = (each.needed[found] - 1).clip(max=study.total[found] - 1)
    learned = steps[found, last]
    order = np.argsort(first)
    rank = np.arange(len(found)) + 1
    size = 4 if len(found) < 50 else 1.5
    ax.plot(
        first[order],
        rank,
        "o",
        ms=size + 3,
        color=BLUE,
        alpha=0.4,
        mew=0,
        label="found for the first time",
    )
    ax.plot(learned[order], rank, "o", ms=size, color=RED, label="values execute it for good")
    ax.set_ylabel(f"run, of {len(found)} that found it")
    ax.legend(frameon=False, fontsize=8, loc="upper left")
    _phase(ax, study)


def _errors(ax: Axes, study: Study) -> None:
    middle = (np.arange(BINS) + 0.5) * study.config.steps / BINS
    curves = study.results["td_error"]["curves"]
    ax.plot(middle, curves["value_cell"], color=FAINT, lw=1.2, label="value cell alone, mean |v|")
    ax.plot(middle, curves["with_reward"], color=RED, lw=2, label="with the reward")
    ax.set_ylabel("mean size a transition (units of Q)")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False, fontsize=8)
    _phase(ax, study)


def _example(ax: Axes, study: Study) -> None:
    run = example_run(study)
    if run is None:
        return
    steps = np.concatenate(([0], reward_steps(study, run), [study.config.steps]))
    total = np.arange(len(steps)).clip(max=len(steps) - 2)
    ax.step(steps, total, where="post", color=GREEN, lw=2, label=f"run {run}")
    early = steps[1:-1] < study.config.explore
    ax.plot(steps[1:-1][early], total[1:-1][early], "o", ms=5, color=GREEN)
    ax.set_ylabel("rewards")
    ax.legend(frameon=False, fontsize=8, loc="upper left")
    _phase(ax, study)


def example(study: Study, run: int, folder: Path, steps: int = 1500) -> tuple[Record, Config]:
    """What the nodes of one run did while it explored, and with what it had learned in the end.

    Batches keep no activations: an agent of the same fate lives again for ``steps``.
    """
    numbered = WORLDS[study.config.world].numbered
    config = replace(study.config, steps=2 * steps, explore=steps)
    if not numbered:
        config = replace(config, seed=config.seed + run)
    again = Run(Group(config, agents=(run,)) if numbered else config)
    again.advance(steps)
    last = int(study.total[run]) - 1
    learned = torch.from_numpy(study.runs.weights[run, last].swapaxes(-1, -2).copy())
    again.agent.weights.copy_(learned)
    again.advance(steps)
    again.close()
    return again.record.member(0) if numbered else again.record, config


def learning_law(study: Study) -> Figure:
    """The weight change of the old pair against the regression, and the yoked correlation."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    law, yoked, values = figure.subplots(1, 3)
    entry = study.results["update_regression"]
    t = transitions(study.runs, study.success.found, study.results["theory"]["discount"])
    if len(t.run):
        pick = np.random.default_rng(0).permutation(len(t.run))[:4000]
        predicted = (
            entry["next_coefficient"] * t.next
            + entry["old_coefficient"] * t.old
            + entry["reward_coefficient"] * t.rewarded
        )
        paid = t.rewarded[pick] > 0
        for which, color, label in ((~paid, BLUE, "no reward"), (paid, GREEN, "reward")):
            x, y = predicted[pick][which], t.change[pick][which]
            law.plot(x, y, ".", ms=2, color=color, label=label)
        law.axline((0, 0), slope=1, color=INK, lw=0.8)
        law.legend(frameon=False, fontsize=8)
    law.set_title(f"learning law, R² = {_number(entry['r2'])}", loc="left", color=INK)
    law.set_xlabel("a₁ γQ(s',a') − a₂ Q(s,a) + b R")
    law.set_ylabel("weight change of the old pair")
    curve = study.results["yoked"].get("over_behaviors", {})
    yoked.plot(list(curve), list(curve.values()), color=BLUE, lw=2)
    yoked.set_title("values: neural against yoked discrete", loc="left", color=INK)
    yoked.set_xlabel("behaviours")
    yoked.set_ylabel("mean correlation")
    lowest = min(curve.values(), default=0.9)
    yoked.set_ylim(min(0.9, lowest), 1.002)
    _coefficients(values, study)
    for ax in (law, yoked, values):
        tidy(ax)
    return figure


def _coefficients(ax: Axes, study: Study) -> None:
    entry, theory = study.results["update_regression"], study.results["theory"]
    for k, name in enumerate(("next", "old", "reward")):
        ax.bar(k - 0.2, theory[name], 0.38, color=FAINT, label="theory" if k == 0 else None)
        for shift, phase, color in ((0.1, "exploration", BLUE), (0.3, "exploitation", RED)):
            if phase in entry:
                ax.bar(k + shift, entry[phase][f"{name}_coefficient"], 0.19, color=color,
                       label=phase if k == 0 else None)  # fmt: skip
    ax.set_xticks(range(3), ["γQ(s',a')", "−Q(s,a)", "reward"])
    ax.set_title("coefficients, a transition", loc="left", color=INK)
    ax.set_ylim(0, 1.35 * max(theory[name] for name in ("next", "old", "reward")))
    ax.legend(frameon=False, fontsize=8, loc="upper left", ncols=3)


def exploration(study: Study) -> Figure:
    """How often each behaviour follows the last two while exploring."""
    counts, colors = study.results["transition_counts"], study.config.colors
    n = len(colors)
    figure = Figure(figsize=(2.6 * n, 3.2), layout="constrained")
    axes = figure.subplots(1, n, sharey=True)
    share = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    for i, ax in enumerate(np.atleast_1d(axes)):
        image = ax.imshow(share[i], vmin=0, vmax=0.5, cmap="Blues")
        for (j, k), value in np.ndenumerate(share[i]):
            if j != i and k != j:
                ink = "white" if value > 0.3 else INK
                weight = "bold" if k == i else "normal"  # a return
                ax.text(k, j, f"{value:.2f}", ha="center", va="center", color=ink, weight=weight)
        ax.set_title(f"after {colors[i]}, then …", color=INK, fontsize=10)
        ax.set_xticks(range(n), colors)
        ax.set_yticks(range(n), colors)
        ax.set_xlabel("next")
    figure.colorbar(image, ax=axes, shrink=0.8, label="share (1/3 if uniform)")
    return figure


def _number(value: float) -> str:
    return f"{value:.4f}" if value is not None and np.isfinite(value) else "–"


def tidy(ax: Axes) -> None:
    """Thin frame, no clutter."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8, colors=INK)
    ax.grid(axis="y", color=SHADE, lw=0.8)
    ax.set_axisbelow(True)

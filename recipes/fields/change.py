"""Change detection: three layers compare what is seen with what is remembered.

One to four coloured items are shown for a second and vanish; 1.5 seconds later they come back,
and in half of the trials one has another colour. Items that are seen build peaks in a field of
memory, which holds them in the dark. Through a layer of inhibition each of them presses a trough
into the field that sees. An item of the same colour falls into its trough and raises no peak; one
of a new colour falls beside all troughs and raises one, which turns on the answer "different".
All trials run at once, as a batch.

Source: Johnson, Spencer, Luck and Schöner, "A dynamic neural field model of visual working memory
and change detection", Psychological Science 20, 2009; the numbers are not theirs. Five seconds on
one core.

    python recipes/fields/change.py --trials 64 --out change.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Architecture, Gauss, Global, gauss, rollout

HUES, MOST = 120, 4
SHOW, DARK, TEST = 32, 48, 32  # steps of 1/32 s


def three_layers() -> Architecture:
    """All kernels over hue; the answer is a node."""
    return Architecture(
        {
            "see": DNF(HUES, Gauss(8.0, 3.0)),
            "inhibit": DNF(HUES, ()),
            "remember": DNF(HUES, Gauss(16.0, 3.0)),
            "different": DNF((), Global(3.0)),
        },
        ("see", "inhibit", Gauss(10.0, 3.0)),
        ("remember", "inhibit", Gauss(8.0, 3.0)),
        ("see", "remember", Gauss(6.0, 3.0)),
        ("inhibit", "see", Gauss(-8.0, 3.0)),
        ("inhibit", "remember", Gauss(-8.0, 9.0)),
        ("see", "different", "hue ->", 1.0),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument("--out", default="change.png")
    arguments = parser.parse_args()
    torch.manual_seed(0)

    trials = arguments.trials
    count = torch.arange(trials) % MOST + 1
    changed = torch.arange(trials) // MOST % 2 == 1
    places = torch.stack([torch.randperm(6) for _ in range(trials)]) * HUES / 6
    hues = (places + HUES * torch.rand(trials, 1)) % HUES  # six hues per trial, the last one new
    there = (torch.arange(6) < count[:, None]).float()
    again = torch.where(changed[:, None] & (torch.arange(6) == 0), hues[:, -1:], hues)
    first, second = (gauss(HUES, x, 2.5, there).sum(1) for x in (hues, again))

    phases = (first, SHOW), (torch.zeros_like(first), DARK), (second, TEST)
    display = torch.cat([x.expand(steps, -1, -1) for x, steps in phases])
    asked = torch.zeros(len(display), trials)
    asked[-TEST:] = 3.0
    inputs = {"see": 9.0 * display, "remember": 1.5 * display, "different": asked}
    model = three_layers()
    outputs, states = rollout(model, inputs, model.initial([trials]))

    answers = outputs["different"][-1] > 0.5
    held = outputs["remember"][-TEST - 1].gather(1, hues.round().long() % HUES)
    kept = ((held > 0.5) * there).sum() / there.sum()
    right = [float((answers == changed)[count == n].float().mean()) for n in range(1, MOST + 1)]
    told = ", ".join(f"{x:.0%}" for x in right)
    print(f"{kept:.0%} of the items are held in the dark; right answers for 1 to 4 items: {told}")
    assert kept > 0.95, "forgotten"
    assert min(right) > 0.9, "not compared"

    figure = Figure(figsize=(7, 4), layout="constrained")
    trial = int((changed & (count == 3)).nonzero()[0])
    names = ["see", "inhibit", "remember"]
    for name, axes in zip(names, figure.subplots(3, 1, sharex=True)):
        u = states[name][:, trial].t().numpy()
        image = axes.imshow(
            u,
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            vmin=-12,
            vmax=12,
            extent=(0, len(display) / 32, 0, HUES),
        )
        axes.set(ylabel=f"{name}: hue")
    axes.set_xlabel("time (s): three items, dark, one of them changed")
    figure.colorbar(image, ax=figure.axes, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

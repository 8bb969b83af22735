"""A not B: where somebody reached before draws the next reach.

A toy is hidden six times in box A, and an infant reaches there; then, before its eyes, it is
hidden in box B. After a delay of some seconds infants of eight months reach to A again, those of
a year to B. The field stands for the reach: both boxes are always there, the hiding is a cue
that goes. Every reach leaves a memory trace, which preshapes the field. In the young field,
whose resting level is low, the cue's activation fades within the delay and the trace decides; the
old one holds a peak on its own from the cue to the reach. Both ages are rows of one batch.

Source: Thelen, Schöner, Scheier and Smith, "The dynamics of embodiment: a field theory of infant
perseverative reaching", Behavioral and Brain Sciences 24, 2001. Five seconds on one core.

    python recipes/fields/a_not_b.py --out a_not_b.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Architecture, Gauss, Global, MemoryTrace, gauss, rollout

SITES, A, B = 60, 18, 42
AGES = {"young": -5.2, "old": -3.5}  # resting level
HIDE, REACH, PAUSE = 32, 32, 32  # steps of 1/32 s
DELAYS = [0, 0, 64, 64, 64, 64, 64]  # in each trial; none while it is taught to reach


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="a_not_b.png")
    arguments = parser.parse_args()

    model = Architecture(
        {
            "reach": DNF(SITES, (Gauss(17.0, 3.0), Global(-1.0)), h=torch.tensor([*AGES.values()])),
            "trace": MemoryTrace(SITES, tau_build=3.0, tau_decay=20.0),
        },
        ("reach", "trace"),
        ("trace", "reach", Gauss(2.0, 3.0)),
    )
    boxes = gauss(SITES, A, 3.0) + gauss(SITES, B, 3.0)

    def trial(hidden: int, delay: int) -> torch.Tensor:
        """Hide, delay, push the boxes near for a reach, take them away."""
        seen = boxes + gauss(SITES, hidden, 3.0, 6.0)
        phases = (seen, HIDE), (boxes, delay), (4.5 * boxes, REACH), (boxes - 6.0, PAUSE)
        return torch.cat([x.expand(steps, -1) for x, steps in phases])

    inputs = torch.cat([trial(B if k == 6 else A, delay) for k, delay in enumerate(DELAYS)])
    batch = inputs[:, None].expand(-1, len(AGES), -1)
    outputs, states = rollout(model, {"reach": batch}, model.initial([len(AGES)]))

    last = torch.tensor([HIDE + delay + REACH + PAUSE for delay in DELAYS]).cumsum(0) - PAUSE - 1
    ends = outputs["reach"][last]  # at the end of each reach
    reached = torch.where(ends[..., A] > ends[..., B], A, B)
    names = ["A" if x == A else "B" for x in reached[-1].tolist()]
    print(
        f"six reaches to A, then hidden at B: the young one reaches to {names[0]}, the old one "
        f"to {names[1]}; trace at A {states['trace'][-1, 0, A]:.2f} and "
        f"{states['trace'][-1, 1, A]:.2f}"
    )
    assert (reached[:6] == A).all() and (ends.amax(-1) > 0.9).all(), "no reach to A"
    assert names == ["A", "B"], "no A-not-B error, or no end to it"

    figure = Figure(figsize=(7, 3.2), layout="constrained")
    for row, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        image = axes.imshow(
            states["reach"][:, row].t().numpy(),
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            extent=(0, len(inputs) / 32, 0, SITES),
            vmin=-12,
            vmax=12,
        )
        axes.set(
            title=[*AGES][row], ylabel="position (sites)", yticks=[A, B], yticklabels=["A", "B"]
        )
    axes.set_xlabel("time (s); in the last trial the toy is hidden at B")
    figure.colorbar(image, ax=figure.axes, label="activation u")
    figure.savefig(arguments.out, dpi=64)


if __name__ == "__main__":
    main()

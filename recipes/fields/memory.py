"""Working memory: a peak that outlives its stimulus.

Two fields with the same kernel, excitation near by and inhibition farther off, differ only in
their resting level. Two stimuli appear for half a second and are gone. In the field with the low
resting level the peaks go with them; in the other one both stay for as long as it is left alone,
each where its stimulus was. The two fields are two rows of one batch: a resting level may be a
tensor with one number per row.

Source: Schöner, Spencer and the DFT Research Group, "Dynamic Thinking: A Primer on Dynamic Field
Theory", 2015, chapter 2. Two seconds on one core.

    python recipes/fields/memory.py --out memory.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Gauss, gauss, rollout

SITES, PLACES, SHOWN, STEPS = 80, (22.0, 57.0), 16, 128
LEVELS = [-6.5, -4.0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="memory.png")
    arguments = parser.parse_args()

    field = DNF(SITES, (Gauss(16.0, 3.0), Gauss(-10.0, 8.0)), h=torch.tensor(LEVELS))
    both = gauss(SITES, torch.tensor(PLACES), 3.0, 7.0).sum(0)
    inputs = torch.zeros(STEPS, len(LEVELS), SITES)
    inputs[:SHOWN] = both
    outputs, states = rollout(field, inputs)

    faded, kept = outputs[-1].amax(-1).tolist()
    halves = outputs[-1, 1].split(SITES // 2)
    site = torch.arange(SITES // 2)
    found = [float((x * site).sum() / x.sum()) + k * SITES // 2 for k, x in enumerate(halves)]
    drift = max(abs(a - b) for a, b in zip(found, PLACES))
    print(
        f"{(STEPS - SHOWN) / 32:.1f} s in the dark: output {faded:.2f} at h = {LEVELS[0]}, "
        f"{kept:.2f} at h = {LEVELS[1]}, peaks {drift:.2f} sites from their stimuli"
    )
    assert outputs[SHOWN - 1].amax(-1).min() > 0.9, "not detected"
    assert faded < 0.1 and kept > 0.9, "no working memory"
    assert drift < 1, "moved"

    figure = Figure(figsize=(7, 2.6), layout="constrained")
    for row, axes in enumerate(figure.subplots(1, 2)):
        image = axes.imshow(
            states.u[:, row].t().numpy(),
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            extent=(0, STEPS / 32, 0, SITES),
            vmin=-10,
            vmax=10,
        )
        axes.axvline(SHOWN / 32, color="black", lw=0.8, ls=":")
        axes.set(title=f"h = {LEVELS[row]}", xlabel="time (s)", ylabel="position (sites)")
    figure.colorbar(image, ax=axes, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

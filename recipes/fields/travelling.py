"""A travelling peak: a kernel that is not symmetric pushes a peak around a ring.

Each site excites not its neighbours on both sides but those a little to its right. A peak that
was set up once then travels, without any input, at a constant speed that grows with the shift of
the kernel; a shift to the left carries it to the left. This is how a ring of cells can keep track
of the direction of a head that turns.

Source: Zhang, "Representation of spatial orientation by the intrinsic dynamics of the
head-direction cell ensemble: a theory", Journal of Neuroscience 16, 1996; Amari, 1977. Two
seconds on one core.

    python recipes/fields/travelling.py --out travelling.png
"""

import argparse
import math

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Gauss, Global, gauss, rollout

SITES, START, STEPS = 90, 20, 160
SHIFTS = [-1.0, 0.0, 0.5, 1.0]  # sites


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="travelling.png")
    arguments = parser.parse_args()

    field = DNF(SITES, h=-3.0, steepness=1.0)
    inputs = torch.zeros(STEPS, SITES)
    inputs[:16] = gauss(SITES, START, 4.0, 6.0)
    angle = 2 * math.pi * torch.arange(SITES) / SITES
    speeds, spreads, pictures = [], [], []
    for shift in SHIFTS:
        field.kernel = (Gauss(22.0, 4.0, shift), Global(-0.9))
        outputs, states = rollout(field, inputs)
        place = torch.atan2(outputs @ angle.sin(), outputs @ angle.cos()) * SITES / 2 / math.pi
        steps = (place[33:] - place[32:-1] + SITES / 2) % SITES - SITES / 2  # sites per step
        speeds.append(32 * steps.mean().item())
        spreads.append(32 * steps.std().item())
        pictures.append(states.u)
    told = ", ".join(f"{s:+.1f}: {v:+.1f}" for s, v in zip(SHIFTS, speeds))
    print(f"sites per second for a kernel shifted by {told}; at most {max(spreads):.2f} of spread")
    left, still, slow, fast = speeds
    assert abs(still) < 0.01 and fast > 1.5 * slow > 0, "speed does not grow with the shift"
    assert abs(left + fast) < 0.01 * fast, "left is not right mirrored"
    assert max(spreads) < 0.1 * fast, "not constant"

    figure = Figure(figsize=(7, 2.4), layout="constrained")
    for shift, u, axes in zip(SHIFTS, pictures, figure.subplots(1, 4, sharey=True)):
        image = axes.imshow(
            u.t().numpy(),
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            extent=(0, STEPS / 32, 0, SITES),
            vmin=-12,
            vmax=12,
        )
        axes.set(title=f"shift {shift:+.1f}", xlabel="time (s)")
    figure.axes[0].set_ylabel("position (sites)")
    figure.colorbar(image, ax=figure.axes, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

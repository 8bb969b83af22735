"""A coordinate transformation: the eyes move, and the place of the target stays.

Where a target is seen on the retina and where the eyes point to are two fields. Both together
raise a peak in a field over both, and all pairs with the same sum lie on one diagonal of it: the
sum over each diagonal is the direction of the target from the body. The eyes jump twice. The
image on the retina jumps, too, while the peak in the field of the body stays where it is. In the
same way backwards, the field of the body tells where on the retina the target has to be.

Source: Schneegans and Schöner, "A neural mechanism for coordinate transformation predicts
pre-saccadic remapping", Biological Cybernetics 106, 2012. Two seconds on one core.

    python recipes/fields/coordinates.py --out coordinates.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Architecture, Gauss, Global, Projection, gauss, rollout

SITES, TARGET = 41, 45  # sites per axis; direction of the target from the body
GAZES, STEPS = (25, 12, 32), 32  # three directions of the eyes, for one second each


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="coordinates.png")
    arguments = parser.parse_args()

    one_peak = (Gauss(15.0, 2.0), Global(-0.8))
    model = Architecture(
        {
            "retina": DNF(SITES, one_peak, border="zero"),
            "gaze": DNF(SITES, one_peak, border="zero"),
            "both": DNF((SITES, SITES), (Gauss(8.0, 2.0), Global(-0.05)), border="zero"),
            "body": DNF(2 * SITES - 1, one_peak, border="zero"),
        },
        ("retina", "both", "r -> r g", 3.5),
        ("gaze", "both", "g -> r g", 3.5),
        ("both", "body", "r g -> r+g", 2.0),
    )
    seen = torch.cat([gauss(SITES, TARGET - g, 2.0, 8.0, "zero").expand(STEPS, -1) for g in GAZES])
    eyes = torch.cat([gauss(SITES, g, 2.0, 8.0, "zero").expand(STEPS, -1) for g in GAZES])
    outputs, states = rollout(model, {"retina": seen, "gaze": eyes})

    ends = torch.arange(1, len(GAZES) + 1) * STEPS - 1
    peaks = {name: states[name][ends].argmax(-1).tolist() for name in ("retina", "gaze", "body")}
    backward = Projection("r+g -> r g", 2 * SITES - 1, (SITES, SITES))(outputs["body"][ends])
    expected = (backward * outputs["gaze"][ends, None]).sum(-1).argmax(-1).tolist()
    print(
        f"eyes at {peaks['gaze']}, image on the retina at {peaks['retina']}, expected at "
        f"{expected}, target from the body at {peaks['body']}"
    )
    assert max(abs(place - TARGET) for place in peaks["body"]) <= 1, "not where the target is"
    assert len(set(peaks["retina"])) == len(GAZES), "the image did not move"
    assert max(abs(a - b) for a, b in zip(peaks["retina"], expected)) <= 1, "not backwards"

    figure = Figure(figsize=(7, 2.2), layout="constrained")
    for name, axes in zip(peaks, figure.subplots(1, 3)):
        image = axes.imshow(
            states[name].t().numpy(),
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            extent=(0, len(seen) / 32, 0, states[name].shape[-1]),
            vmin=-10,
            vmax=10,
        )
        axes.set(title=name, xlabel="time (s)")
    figure.colorbar(image, ax=figure.axes, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

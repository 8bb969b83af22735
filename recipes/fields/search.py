"""Visual search: where is the red one?

A scene field over colour and space holds four to twelve coloured items. The colour that is looked
for stands as a peak in a field of colour, which lifts one slice of the scene over the threshold. A
field of space adds up what is on in the scene, takes one place, and attends it: there the scene is
lifted, too. All items compete at once: twelve take no longer than four.

Source: Grieben, Tekülve, Zibner, Lins, Schneegans and Schöner, "Scene memory and spatial inhibition
in visual search", Attention, Perception, and Psychophysics 82, 2020, in a reduced form. Five
seconds on one core.

    python recipes/fields/search.py --scenes 18 --out search.png
"""

import argparse

import torch
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure

from dntorch import DNF, Architecture, Gauss, Global, gauss, rollout

HUES, SIDE, STEPS = 24, 32, 48
COUNTS = [4, 8, 12]  # items in a scene


def visual_search() -> Architecture:
    """Scene over hue, y and x; colour over hue; attention over y and x."""
    return Architecture(
        {
            "scene": DNF((HUES, SIDE, SIDE), ()),
            "colour": DNF(HUES, (Gauss(15.0, 1.5), Global(-0.5))),
            "space": DNF((SIDE, SIDE), (Gauss(25.0, 2.0), Global(-0.8))),
        },
        ("colour", "scene", "hue -> hue y x", 2.5),
        ("scene", "space", "hue y x -> y x", Gauss(16.0, 1.5)),
        ("space", "scene", "y x -> hue y x", 1.0),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=18)
    parser.add_argument("--out", default="search.png")
    arguments = parser.parse_args()
    torch.manual_seed(0)

    scenes = arguments.scenes
    most = COUNTS[-1]
    grid = torch.stack([torch.randperm(16)[:most] for _ in range(scenes)])
    y, x = (4.0 + 8 * k + torch.randint(-1, 2, k.shape) for k in (grid // 4, grid % 4))
    hues = torch.stack([torch.randperm(12)[:most] for _ in range(scenes)]) * 2.0
    count = torch.tensor(COUNTS)[torch.arange(scenes) % len(COUNTS)]
    there = (torch.arange(most) < count[:, None]).float()
    retina = gauss((HUES, SIDE, SIDE), (hues, y, x), (0.8, 1.5, 1.5), 4.0 * there).sum(1)
    cue = gauss(HUES, hues[:, 0], 1.5, 7.0)  # look for the first item

    model = visual_search()
    inputs = {"scene": retina.expand(STEPS, *retina.shape), "colour": cue.expand(STEPS, -1, -1)}
    outputs, states = rollout(model, inputs, model.initial([scenes]))

    space = outputs["space"][-1]
    best = space.flatten(1).argmax(1)
    miss = torch.hypot(best // SIDE - y[:, 0], best % SIDE - x[:, 0])
    found = float((miss < 2).float().mean())
    on = outputs["space"].flatten(2).amax(-1) > 0.5
    time = on.float().argmax(0) / 32
    times = [float(time[count == n].mean()) for n in COUNTS]
    told = ", ".join(f"{x:.2f}" for x in times)
    print(
        f"in {found:.0%} of {scenes} scenes attention is on the one looked for; seconds to find it "
        f"among {', '.join(map(str, COUNTS))} items: {told}"
    )
    assert found == 1 and on[-1].all(), "not found"
    assert max(times) - min(times) < 0.1, "more items take longer"

    figure = Figure(figsize=(7, 2.6), layout="constrained")
    picture, attention, colour = figure.subplots(1, 3)
    k = len(COUNTS) - 1  # a scene with most items
    colours = torch.full((most, 3), 0.9)
    colours[:, 0] = hues[k] / HUES
    picture.scatter(x[k], y[k], c=hsv_to_rgb(colours.numpy()), s=60)
    picture.plot(x[k, 0], y[k, 0], "o", mec="black", mfc="none", ms=14)
    picture.set(title="scene, circle: looked for", xlim=(0, SIDE), ylim=(0, SIDE), aspect="equal")
    u = states["space"][-1, k].numpy()
    image = attention.imshow(u, origin="lower", cmap="RdBu_r", vmin=-12, vmax=12)
    attention.set(title="space: activation u")
    figure.colorbar(image, ax=attention, shrink=0.8)
    colour.plot(states["colour"][-1, k])
    colour.axhline(0, color="gray", lw=0.7)
    colour.set(title="colour: activation u", xlabel="hue (sites)")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

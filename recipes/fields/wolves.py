"""WOLVES: a large model of how children learn words, loaded from its COSIVINA file.

Two novel objects lie to the left and to the right, each a peak over feature and space in two visual
fields, and a word is said. All 43 fields and memory traces are addressed by the labels of the file.
Spatial attention rises at both objects, most at the left one, which is favoured a little; having
looked there inhibits looking there again, and the right one alone is attended. Meanwhile the field
over words and features binds the word that is said to a feature of the left object.

Source: Bhat, Spencer and Samuelson, "Word-Object Learning via Visual Exploration in Space (WOLVES):
a neural process model of cross-situational word learning", Psychological Review 129, 2022. The file
is wolvesPaperPR.json of the public repository cosivina/cosivina_dft_projects. Seven seconds on one
core.

    python recipes/fields/wolves.py wolvesPaperPR.json --out wolves.png
"""

import argparse
from pathlib import Path

import torch
from matplotlib.figure import Figure

from dntorch import cosivina, gauss

FEATURES, SPACE, WORDS = 306, 100, 20
LEFT, RIGHT, WORD = 25.0, 75.0, 4
OBJECTS = {"vis_f1": (100.0, 200.0), "vis_f2": (60.0, 250.0)}  # two features of left and right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="wolvesPaperPR.json")
    parser.add_argument("--steps", type=int, default=70, help="of 1 ms of the model's time")
    parser.add_argument("--out", default="wolves.png")
    arguments = parser.parse_args()

    model = cosivina.load(arguments.file)
    given = {"atn_sr": gauss(SPACE, LEFT, 5.0, 0.5), "word": 8.0 * torch.eye(WORDS)[WORD]}
    for field, features in OBJECTS.items():
        places = torch.tensor(features), torch.tensor([LEFT, RIGHT])
        given[field] = gauss((FEATURES, SPACE), places, 5.0, 10.0).sum(0)
    names = ["atn_sr", "con_f1", "wf1"]
    courses = {name: [] for name in names}
    with torch.no_grad():
        for _ in range(arguments.steps):
            model(given)
            for name in names:
                courses[name].append(model.state[name])
    courses = {name: torch.stack(x) for name, x in courses.items()}

    space = courses["atn_sr"]
    looks = space.argmax(-1)[space.amax(-1) > 0].unique_consecutive().tolist()
    feature, word = divmod(int(courses["wf1"][-1].argmax()), WORDS)
    print(
        f"{len(model.state)} states and {len(model.links)} links; looks at {looks}, "
        f"binds word {word} with feature {feature}"
    )
    assert abs(looks[0] - LEFT) < 3 and abs(looks[-1] - RIGHT) < 3, "did not look at both"
    assert word == WORD and abs(feature - OBJECTS["vis_f1"][0]) < 3, "not what was named"

    figure = Figure(figsize=(7, 2.6), layout="constrained")
    titles = "attention over space", "contrast over feature", "words and features"
    for name, title, axes in zip(names, titles, figure.subplots(1, 3)):
        u = courses[name].t() if name != "wf1" else courses[name][-1]
        image = axes.imshow(
            u.numpy(), origin="lower", aspect="auto", cmap="RdBu_r", vmin=-12, vmax=12
        )
        axes.set(title=f"{title}\n{name}", xlabel="word" if name == "wf1" else "time (ms)")
    figure.colorbar(image, ax=figure.axes, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

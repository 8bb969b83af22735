"""Selection: of two things that are there, a field takes one.

Two stimuli stand at two places of a field whose sites far apart inhibit each other. In each of
many trials, run at once as a batch, exactly one peak comes up. Which one it is depends on noise
where both are equal, and more and more on strength where they are not. Once a peak stands it
keeps the other down: it stays even if the other stimulus then becomes the stronger one.

Source: Wilimzig, Schneider and Schöner, "The time course of saccadic decision making: dynamic
field theory", Neural Networks 19, 2006. Four seconds on one core.

    python recipes/fields/selection.py --trials 200 --out selection.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Noise, gauss, rollout

SITES, LEFT, RIGHT = 60, 15, 45
AHEAD = [0.0, 0.5, 1.0, 1.5]  # by how much the right stimulus is stronger
STEPS = 64


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=200, help="for each difference")
    parser.add_argument("--out", default="selection.png")
    arguments = parser.parse_args()
    torch.manual_seed(0)

    trials = (arguments.trials, len(AHEAD))
    field, noise = DNF(SITES), Noise(SITES, sd=0.5, sigma=2.0)
    left, right = gauss(SITES, LEFT, 3.0, 6.0), gauss(SITES, RIGHT, 3.0, 6.0 + torch.tensor(AHEAD))
    white = torch.randn(STEPS, *trials, SITES)
    _, states = rollout(field, left + right + noise(white), field.initial(list(trials)))

    then = gauss(SITES, LEFT, 3.0, 7.5) + gauss(SITES, RIGHT, 3.0, 6.0)  # now the left is stronger
    later, _ = rollout(field, then.expand(STEPS, *trials, SITES), type(states)(states.u[-1]))

    ends = states.u[-1] > 0
    single = (ends[..., LEFT] ^ ends[..., RIGHT]).float().mean().item()
    share = ends[..., RIGHT].float().mean(0)
    kept = ((later[-1] > 0.5)[..., RIGHT] == ends[..., RIGHT]).float().mean().item()
    told = ", ".join(f"{x:.0%}" for x in share)
    print(
        f"one peak in {single:.0%} of the trials; the right one in {told} if it is ahead by "
        f"0, .5, 1, 1.5; {kept:.0%} stay when the other becomes stronger"
    )
    assert single == 1, "no selection"
    assert abs(share[0] - 0.5) < 0.2 and share[-1] > 0.9, "not by strength"
    assert kept > 0.9, "not stable"

    figure = Figure(figsize=(7, 2.8), layout="constrained")
    chance, runs = figure.subplots(1, 2)
    chance.plot(AHEAD, share, "C0o-")
    chance.set(xlabel="right stimulus stronger by", ylabel="share of right peaks", ylim=(0, 1.05))
    time = torch.arange(STEPS) / 32
    for k in range(min(12, arguments.trials)):
        runs.plot(time, states.u[:, k, 0, LEFT], "C3", lw=0.7, label=None if k else "left")
        runs.plot(time, states.u[:, k, 0, RIGHT], "C0", lw=0.7, label=None if k else "right")
    runs.axhline(0, color="gray", lw=0.7)
    runs.set(xlabel="time (s), equal stimuli", ylabel="activation u")
    runs.legend(frameon=False)
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

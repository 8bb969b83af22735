"""Detection: a field decides that something is there, and holds on to that decision.

A stimulus at one place of a field grows slowly from nothing and then shrinks again. At first the
field only follows it. At a certain strength the activation jumps over the threshold: a peak
stands, the detection decision. On the way back the peak outlives that strength, since its sites
excite each other; it falls at a weaker one. Between the two strengths the field shows what it
has seen before: hysteresis, which keeps a decision stable although its input is noisy.

Source: Schöner, Spencer and the DFT Research Group, "Dynamic Thinking: A Primer on Dynamic Field
Theory", 2015, chapter 2. Two seconds on one core.

    python recipes/fields/detection.py --out detection.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Gauss, Global, gauss, rollout

SITES, PLACE, HIGHEST = 60, 30, 8.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=640, help="of 1/32 s, up and down")
    parser.add_argument("--out", default="detection.png")
    arguments = parser.parse_args()

    field = DNF(SITES, (Gauss(14.0, 3.0), Global(-0.4)))
    up = torch.linspace(0.0, HIGHEST, arguments.steps // 2)
    strength = torch.cat([up, up.flip(0)])
    inputs = gauss(SITES, PLACE, 3.0, strength)  # a stimulus for each step
    _, states = rollout(field, inputs)

    top = states.u.amax(-1)
    on = top > 0
    half = len(up)
    detected = strength[on.nonzero()[0, 0]].item()
    forgotten = strength[on.nonzero()[-1, 0]].item()
    jump = (top[1:] - top[:-1]).max().item() * 32
    creep = (top[half // 4] - top[half // 8]).item() / (half // 8) * 32
    print(
        f"detected at {detected:.1f}, forgotten at {forgotten:.1f}; "
        f"activation jumps at {jump:.0f} per s, creeps at {creep:.1f} before"
    )
    assert detected > forgotten + 1, "no hysteresis"
    assert jump > 10 * creep, "no jump"

    figure = Figure(figsize=(7, 2.8), layout="constrained")
    loop, profile = figure.subplots(1, 2)
    loop.plot(strength[:half], top[:half], "C3", label="while the stimulus grows")
    loop.plot(strength[half:], top[half:], "C0", label="while it shrinks")
    loop.axhline(0, color="gray", lw=0.7)
    loop.set(xlabel="strength of the stimulus", ylabel="highest activation")
    loop.legend(frameon=False, loc="lower right")
    same = int((up - (detected + forgotten) / 2).abs().argmin())
    profile.plot(inputs[same] - 5, "gray", ls=":", label="stimulus and resting level")
    profile.plot(states.u[same], "C3", label="before the detection")
    profile.plot(states.u[-1 - same], "C0", label="after it, same stimulus")
    profile.axhline(0, color="gray", lw=0.7)
    profile.set(xlabel="position (sites)", ylabel="activation u", ylim=(-9, 14))
    profile.legend(frameon=False)
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

"""Fit: find the kernel of a field from a recording of its activation.

A field whose kernel has an amplitude of 14 and a width of 4 sites is driven by moving stimuli, and
its activation is recorded. Another one begins with 9 and 2.5. Both numbers are tensors that want
gradients; a kernel made of them is set anew in each step of Adam, the field is stepped through
the whole recording by `rollout`, and the gradient flows back through all of it.

Not from a paper. Ten seconds on one core.

    python recipes/fields/fit.py --steps 300 --out fit.png
"""

import argparse

import torch
from matplotlib.figure import Figure
from torch import Tensor

from dntorch import DNF, Gauss, Global, gauss, rollout

SITES, TIMES = 50, 24
TRUE, BEGIN = (14.0, 4.0), (9.0, 2.5)  # amplitude; sigma in sites


def activation(field: DNF, amplitude: float | Tensor, sigma: float | Tensor, inputs: Tensor):
    """Of a field with this kernel, for each step of the inputs."""
    field.kernel = (Gauss(amplitude, sigma), Global(-0.5))
    return rollout(field, inputs, field.initial([inputs.shape[1]]))[1].u


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=300, help="of Adam")
    parser.add_argument("--out", default="fit.png")
    arguments = parser.parse_args()

    field = DNF(SITES, steepness=1.0, dtype=torch.float64)
    move = torch.arange(TIMES, dtype=torch.float64).unsqueeze(-1) / 4
    places = torch.tensor([10.0, 30.0]) + move * torch.tensor([1.0, -0.5])  # of two trials
    inputs = gauss(SITES, places, 3.0, 6.0)
    recorded = activation(field, *TRUE, inputs)

    numbers = torch.tensor(BEGIN, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([numbers], lr=0.2)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, arguments.steps)
    way = [BEGIN]
    for _ in range(arguments.steps):
        loss = (activation(field, *numbers, inputs) - recorded).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        slower.step()
        way.append(tuple(numbers.tolist()))

    errors = [abs(x - y) for x, y in zip(way[-1], TRUE)]
    print(
        f"amplitude {way[-1][0]:.5f}, sigma {way[-1][1]:.5f} after {arguments.steps} steps; "
        f"error at most {max(errors):.1e}"
    )
    assert max(errors) < 1e-3, "not recovered"

    figure = Figure(figsize=(7, 2.6), layout="constrained")
    course, kernels = figure.subplots(1, 2)
    for k, name in enumerate(("amplitude", "sigma")):
        course.plot([x[k] for x in way], f"C{k}", label=name)
        course.axhline(TRUE[k], color=f"C{k}", lw=0.8, ls=":")
    course.set(xlabel="step of Adam", ylabel="number")
    course.legend(frameon=False)
    three = {"true": (TRUE, "black"), "begin": (BEGIN, "C3"), "fit": (way[-1], "C0--")}
    for name, ((amplitude, sigma), style) in three.items():
        bell = gauss(SITES, SITES // 2, sigma)
        kernels.plot(amplitude * bell / bell.sum(), style, label=name)
    kernels.set(xlabel="position (sites)", ylabel="excitation")
    kernels.legend(frameon=False)
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

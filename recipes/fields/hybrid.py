"""A hybrid: a small network in front of fields, trained through their dynamics.

Twelve microphones around a head hear a sound for a third of a second, some of them loud, some
hardly. A network of two layers turns what they hear into an input of a field of direction, which
feeds a working memory. A second later, in silence, the peak of the memory has to stand where the
sound was: this is the only thing that is told. Adam carries the error back through all steps of
both fields into the network. Untrained it guesses; afterwards the memory points to sounds from
directions it never heard.

Not from a paper; hybrid models of this kind train what feeds a field instead of setting it by
hand. Ten seconds on one core.

    python recipes/fields/hybrid.py --steps 100 --out hybrid.png
"""

import argparse
import math

import torch
from matplotlib.figure import Figure
from torch import Tensor, nn

from dntorch import DNF, Architecture, Gauss, Global, rollout

SITES, EARS, HEARD, SILENT = 36, 12, 10, 32  # steps of 1/32 s


def fields() -> Architecture:
    """What is heard now, and what was."""
    return Architecture(
        {
            "direction": DNF(SITES, (Gauss(10.0, 2.0), Global(-0.5)), steepness=1.0),
            "memory": DNF(SITES, (Gauss(16.0, 2.0), Global(-1.0)), h=-2.5, steepness=1.0),
        },
        ("direction", "memory", Gauss(6.0, 2.0)),
    )


def hear(angle: Tensor, gains: Tensor) -> Tensor:
    """Loudness at each microphone, which is louder the nearer it points to the sound."""
    ears = 2 * math.pi * torch.arange(EARS) / EARS
    loud = torch.exp(2 * torch.cos(angle.unsqueeze(-1) - ears) - 2)
    return gains * loud + 0.02 * torch.randn(len(angle), EARS)


def remember(network: nn.Module, model: Architecture, sound: Tensor) -> tuple[Tensor, Tensor]:
    """Activation of both fields over time."""
    drive = 4.0 + 5.0 * network(sound)  # begins near the threshold
    inputs = torch.cat([drive.expand(HEARD, -1, -1), torch.zeros(SILENT, *drive.shape)])
    _, states = rollout(model, {"direction": inputs}, model.initial([len(sound)]))
    return states["direction"], states["memory"]


def error(memory: Tensor, angle: Tensor) -> Tensor:
    """Degrees between the peak of a memory and the sound; 180 without a peak."""
    away = (memory.argmax(-1) * 2 * math.pi / SITES - angle).remainder(2 * math.pi)
    away = torch.minimum(away, 2 * math.pi - away).rad2deg()
    return torch.where(memory.amax(-1) > 0, away, 180.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100, help="of Adam, 32 sounds each")
    parser.add_argument("--out", default="hybrid.png")
    arguments = parser.parse_args()
    torch.manual_seed(0)

    model, gains = fields(), 0.3 + torch.rand(EARS)
    network = nn.Sequential(nn.Linear(EARS, 32), nn.Tanh(), nn.Linear(32, SITES))
    optimizer = torch.optim.Adam(network.parameters(), lr=0.02)
    test = 2 * math.pi * torch.rand(256)
    with torch.no_grad():
        before = error(remember(network, model, hear(test, gains))[1][-1], test)
    losses = []
    for _ in range(arguments.steps):
        angle = 2 * math.pi * torch.rand(32)
        memory = remember(network, model, hear(angle, gains))[1][-1]
        site = (angle * SITES / 2 / math.pi).round().long() % SITES
        loss = nn.functional.cross_entropy(memory, site)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    with torch.no_grad():
        direction, memory = remember(network, model, hear(test, gains))
    after = error(memory[-1], test)
    right = [float((x < 20).float().mean()) for x in (before, after)]
    print(
        f"within 20 degrees after a second of silence: {right[0]:.0%} of new sounds before, "
        f"{right[1]:.0%} after {arguments.steps} steps; median {after.median():.0f} degrees"
    )
    assert right[0] < 0.2 and right[1] > 0.9, "not learned"

    figure = Figure(figsize=(7, 2.6), layout="constrained")
    learning, *pictures = figure.subplots(1, 3)
    learning.plot(losses, lw=0.8)
    learning.set(xlabel="step of Adam", ylabel="loss")
    for name, u, axes in zip(("direction", "memory"), (direction, memory), pictures):
        image = axes.imshow(
            u[:, 0].t().numpy(),
            origin="lower",
            aspect="auto",
            cmap="RdBu_r",
            vmin=-10,
            vmax=10,
            extent=(0, (HEARD + SILENT) / 32, 0, 360),
        )
        axes.axhline(test[0].rad2deg(), color="black", lw=0.8, ls=":")
        axes.set(title=name, xlabel="time (s)", ylabel="degrees")
    figure.colorbar(image, ax=pictures, label="activation u")
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()

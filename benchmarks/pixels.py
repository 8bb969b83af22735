"""Pixels to wheels: cost of an agent-step of `DNSarsa(4, FindColor())` from recorded images.

    python benchmarks/pixels.py [--batches 1 64 1024] [--rounds 11]

What the agent does with an image once it is there: hue map, three fields, core. No world is
stepped. Images are 39 by 52 pixels, as a camera delivers them (channels innermost in memory) and
as a batched world may (outermost). Rows: the hue map alone and the whole agent, eager and
compiled. The floor is ``senses.cpp``: the same in plain C++, one agent after another. First, all
must agree. Two minutes.
"""

import argparse
import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from arrays import preference
from harness import address, build, has_compiler, table, take_turns
from library import innermost
from torch import Tensor
from torch.utils._pytree import tree_leaves, tree_map

from dntorch import DNF, DNSarsa, FindColor
from dntorch.process import settle

SHAPE = (39, 52, 3)


def record(batch: int, steps: int) -> Tensor:
    """Blocks that move over a gray ground, ``(steps, batch, height, width, 3)``."""
    generator = torch.Generator().manual_seed(0)
    images = torch.full((steps, batch, *SHAPE), 128, dtype=torch.uint8)
    noise = torch.randint(0, 40, images.shape, generator=generator).to(torch.uint8)
    colors = torch.tensor([[220, 20, 20], [20, 200, 20], [20, 20, 220], [210, 200, 20]])
    for k in range(batch):
        for place, color in zip((4, 17, 30, 43), colors.roll(k, 0)):
            for t in range(steps):
                left = (place + k + t) % 45
                images[t, k, 8:30, left : left + 7] = color.to(torch.uint8)
    return images + noise


class Agent:
    """An agent that sees one image after the other."""

    def __init__(self, images: Tensor, compiled: bool) -> None:
        self.images, self.compiled = images.unbind(0), compiled
        batch = images.shape[1]
        self.agent = DNSarsa(4, FindColor("RGBY")).spread(batch)
        self.reward, self.noise = torch.zeros(batch), torch.zeros(batch, 4)
        self.state = self.agent.initial([batch])
        if batch > 1:
            self.state, self.noise = tree_map(innermost, self.state), innermost(self.noise)
            # Fields are rows of matrix products: they stay as they are.
            self.state = self.state._replace(sensorimotor=self.agent.initial([batch]).sensorimotor)
        options = {"fullgraph": True, "dynamic": False}
        self.step = torch.compile(self.advance, **options) if compiled else self.advance

    def advance(self, image: Tensor, state: tuple) -> tuple[Tensor, tuple]:
        return self.agent.step({"image": image}, self.reward, self.noise, state)

    @torch.no_grad()
    def __call__(self) -> None:
        for image in self.images:
            self.wheels, self.state = self.step(image, self.state)


class Map:
    """The hue map alone."""

    def __init__(self, images: Tensor, compiled: bool) -> None:
        self.images = images.unbind(0)
        percept = FindColor("RGBY").percept
        self.step = torch.compile(percept, fullgraph=True, dynamic=False) if compiled else percept

    @torch.no_grad()
    def __call__(self) -> None:
        for image in self.images:
            self.step(image)


class Floor:
    """C++, one agent after the other."""

    def __init__(self, images: Tensor) -> None:
        steps, batch = images.shape[:2]
        body = FindColor("RGBY")
        tables = [
            body.blur,
            *(
                kernel[0]
                for field in (body.perception, body.satisfaction)
                for kernel in pair(field)
            ),
            body.heading.kernel_0.sum(0),
            body.hue_bias,
            body.hue_rows,
            body.center,
            body.bearing,
        ]
        self.tables = [table.contiguous().numpy() for table in tables]
        half = body.axle / 2 / body.wheel_radius
        numbers = float(body.perception.everywhere), body.turning_gain, body.scan, body.SOFTNESS
        pointers, floats = ctypes.c_void_p * len(tables), ctypes.c_float * 5

        class Optics(ctypes.Structure):
            _fields_ = (("tables", pointers), ("numbers", floats))

        optics = Optics(pointers(*map(address, self.tables)), floats(*numbers, half))
        agents = np.zeros((batch, 4 + 4 + 4 + 4 * 16 + 1 + 16), np.float32)
        agents[:, :8] = -5
        self.fields = np.full((batch, 2 * 24 * 52 + 52), -5, np.float32)
        self.wheels = np.zeros((batch, 2), np.float32)
        reward, noise = np.zeros(batch, np.float32), np.zeros((batch, 16), np.float32)
        self.held = agents, self.fields, images.numpy(), reward, noise, preference(), optics
        here = Path(__file__).parent
        sources = [(here / name).read_text() for name in ("floor.cpp", "senses.cpp")]
        self.look = build("\n".join(sources)).look
        before, base = [address(x) for x in self.held[:5]], address(self.held[5])
        after = ctypes.byref(optics), address(self.wheels), steps
        self.arguments = *before, batch, base, *after

    def __call__(self) -> None:
        self.look(*self.arguments)


def pair(field: DNF) -> tuple[Tensor, Tensor]:
    """Kernels of the two axes, of a field with one Gaussian."""
    return field.kernel_0, field.kernel_1


def check(one: Agent, other: Agent) -> None:
    """From one state, one step: within rounding."""
    with torch.no_grad():
        pairs = zip(*(tree_leaves(each.step(each.images[0], one.state)) for each in (one, other)))
        assert all(torch.allclose(a.float(), b.float(), atol=1e-4) for a, b in pairs)


def check_floor(floor: Floor, agent: Agent, portions: int) -> None:
    """After the same images, seen from rest: fields and wheels."""
    for _ in range(portions):
        floor()
        agent()
    fields = [x.flatten(1) for x in tree_leaves(agent.state.sensorimotor)]
    pairs = (torch.cat(fields, 1), floor.fields), (agent.wheels, floor.wheels)
    for ours, plain in pairs:
        apart = (ours - torch.from_numpy(plain)).abs().amax(-1)
        assert (apart > 1e-3).float().mean() < 0.02, f"C++ and the library differ by {apart.max()}"
    assert float(agent.wheels.abs().max()) > 0.1, "nobody moved: nothing was compared"


def compare(batch: int, rounds: int) -> None:
    images = record(batch, 64 if batch == 1 else 16 if batch < 1000 else 2)
    planar = images.movedim(-1, 2).contiguous().movedim(2, -1)
    layouts = {"innermost": images, "outermost": planar}
    modes = {"eager": False, "compiled": True} if has_compiler() else {"eager": False}
    runs: dict[str, Callable] = {}
    for layout, seen in layouts.items():
        for mode, compiled in modes.items():
            runs[f"map, {mode}, {layout}"] = Map(seen, compiled)
            runs[f"agent, {mode}, {layout}"] = Agent(seen, compiled)
    floor = "agent, eager, innermost"
    if has_compiler():
        for other in ("innermost", "outermost"):
            check(runs[floor], runs[f"agent, compiled, {other}"])
        runs["agent, C++"] = Floor(images)
        check_floor(runs["agent, C++"], runs[floor], -(-128 // len(images)) if batch < 1000 else 16)
        floor = "agent, C++"
    work = dict.fromkeys(runs, batch * len(images))
    table(f"pixels to wheels, batch {batch}", take_turns(runs, rounds), floor, work)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 64, 1024])
    parser.add_argument("--rounds", type=int, default=11)
    arguments = parser.parse_args()
    settle()
    for batch in arguments.batches:
        compare(batch, arguments.rounds)
        torch.compiler.reset()  # each batch is a shape of its own


if __name__ == "__main__":
    main()

"""Drawing the ring: cost of an image, as a ratio to the same image in plain C++.

    python benchmarks/ring.py [--batches 64 1024] [--rounds 15] [--shape box]

The same rays (one per column of 52, each against 16 blocks) and the same 39 rows, written as
loops in C++ (-O3 -march=native -ffast-math, one thread), eager and compiled torch: the image
alone, then the whole step (judge, task, image). First the images must agree. Prints the median
CPU time of one image over interleaved rounds, and its ratio to the floor. Two minutes, nearly
all of it compiling.
"""

import argparse
import ctypes
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import torch

from dntorch.envs import Ring, RingWorld

FLOOR = r"""
#include <cmath>
#include <cstdint>
#include <algorithm>
#include <limits>
const int N = 16, W = 52, H = 39;
const float R = 0.4f, HALF = 0.04f, EYE = 0.03f, UP = 0.028f, PITCH = 0.39269908f;
extern "C" void draw(const double* wheels, const int64_t* layout, uint8_t* image, int batch,
                     const float* paints, const float* lamp, const uint8_t* floor, float focal) {
  float fx[N], fy[N], slope[W];
  for (int k = 0; k < N; k++) {
    fx[k] = std::cos((k + .5f) * PITCH); fy[k] = std::sin((k + .5f) * PITCH);
  }
  for (int c = 0; c < W; c++) slope[c] = (W / 2 - c) / focal;
  for (int b = 0; b < batch; b++) {
    const double turned = (wheels[2 * b + 1] - wheels[2 * b]) * 0.02 / 0.052;
    const float yaw = std::remainder(turned, 6.283185307179586);
    const float co = std::cos(yaw), si = std::sin(yaw);
    const float ex = EYE * co, ey = EYE * si, inf = std::numeric_limits<float>::max();
    float depth[W], color[3][W], end[W];
    int block[W];
    std::fill(depth, depth + W, inf);
    for (int k = 0; k < N; k++) {
      const float x = R * fx[k] - ex, y = R * fy[k] - ey;
      const float cx = x * fx[k] + y * fy[k], cy = y * fx[k] - x * fy[k];
      const float a = co * fx[k] + si * fy[k], s = si * fx[k] - co * fy[k];
      for (int c = 0; c < W; c++) {
        const float ix = 1 / (a - s * slope[c]), iy = 1 / (s + a * slope[c]);
        const float x1 = (cx - HALF) * ix, x2 = (cx + HALF) * ix;
        const float y1 = (cy - HALF) * iy, y2 = (cy + HALF) * iy;
        const float in = std::max(std::min(x1, x2), std::min(y1, y2));
        const float out = std::min(std::max(x1, x2), std::max(y1, y2));
        const bool hit = (in <= out) & (in > 0) & (in < depth[c]);
        depth[c] = hit ? in : depth[c];
        block[c] = hit ? k : block[c];
      }
    }
    uint8_t top[W], low[W];
    for (int c = 0; c < W; c++) {
      const float dx = co - si * slope[c], dy = si + co * slope[c];
      end[c] = std::min((std::copysign(1.5f, dx) - ex) / dx, (std::copysign(1.5f, dy) - ey) / dy);
      const bool seen = depth[c] < inf;
      const float edge = std::floor(H / 2.f - 1 + UP * focal / (seen ? depth[c] : end[c])) + 1;
      const float over = std::ceil(H / 2.f - 1 - (2 * HALF - UP) * focal / depth[c]);
      low[c] = std::min(std::max(edge, 0.f), (float)H);
      top[c] = seen ? std::min(std::max(over, 0.f), (float)H) : low[c];
    }
    for (int c = 0; c < W; c++) {
      const int k = depth[c] < inf ? block[c] : 0;
      const float x = R * fx[k] - ex, y = R * fy[k] - ey;
      const float cx = x * fx[k] + y * fy[k], cy = y * fx[k] - x * fy[k];
      const float a = co * fx[k] + si * fy[k], s = si * fx[k] - co * fy[k];
      const float dx = a - s * slope[c], dy = s + a * slope[c];
      const float x1 = (cx - std::copysign(HALF, dx)) / dx;
      const float y1 = (cy - std::copysign(HALF, dy)) / dy;
      const float lx = lamp[0] * fx[k] + lamp[1] * fy[k], ly = lamp[1] * fx[k] - lamp[0] * fy[k];
      const float lit = x1 > y1 ? -std::copysign(lx, lx * dx) : -std::copysign(ly, ly * dy);
      const float shade = 0.6f + 0.35f * std::max(lit, 0.f);
      const float* paint = paints + 3 * layout[N * b + k];
      for (int i = 0; i < 3; i++) color[i][c] = std::min(paint[i] * shade, 255.f);
    }
    uint8_t* __restrict out = image + (size_t)b * 3 * H * W;
    for (int i = 0; i < 3; i++) {
      uint8_t wall[W];
      const uint8_t gray = floor[i];
      for (int c = 0; c < W; c++) wall[c] = color[i][c];
      for (int r = 0; r < H; r++)
        for (int c = 0; c < W; c++) {
          const uint8_t below = r < low[c] ? wall[c] : gray;
          out[(i * H + r) * W + c] = r < top[c] ? 255 : below;
        }
    }
  }
}
"""


def build() -> ctypes.CDLL:
    """The floor, compiled for this machine."""
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "ring.cpp"), Path(folder, "ring.so")
        source.write_text(FLOOR)
        flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
        subprocess.run(["g++", *flags, str(source), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library))


def floor_of(world: RingWorld, state, image: torch.Tensor):
    """A call of the floor that fills ``image``, ``(batch, 3, 39, 52)``."""
    camera, draw = world.camera, build().draw
    shading = camera.shading
    parts = state.wheels, state.layout, image, shading.paints, shading.lamp, camera.floor
    wheels, layout, out, paints, lamp, floor = (ctypes.c_void_p(p.data_ptr()) for p in parts)
    focal = ctypes.c_float(world.body.focal)
    return lambda: draw(wheels, layout, out, len(image), paints, lamp, floor, focal)


def compare(batch: int, rounds: int, shape: str) -> None:
    world = RingWorld(ring=Ring(block_shape=shape))
    state = world.initial([batch], seed=torch.arange(batch))
    random = torch.Generator().manual_seed(0)
    state = state._replace(wheels=torch.rand(batch, 2, generator=random).double() * 50)
    action, ours = torch.rand(batch, 2, generator=random), torch.zeros(batch, 3, 39, 52).byte()
    look, step = (
        torch.compile(f, fullgraph=True, dynamic=False) for f in (world.observe, world.step)
    )
    ways = {
        "C++": floor_of(world, state, ours),
        "compiled image": lambda: look(state),
        "compiled step": lambda: step(action, state),
        "eager image": lambda: world.observe(state),
    }
    for way in ways.values():
        way()
    if shape == "box":
        image = look(state)["image"].movedim(-1, -3)
        wrong = ((image.int() - ours.int()).abs() > 1).float().mean()
        assert wrong < 1e-3, f"images differ in {float(wrong):.2%} of their bytes"
    spent: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            repeats, start = max(1, 4096 // batch), time.process_time()
            for _ in range(repeats):
                way()
            spent[name].append((time.process_time() - start) / batch / repeats)
    for name, times in spent.items():
        ratios = [a / b for a, b in zip(times, spent["C++"], strict=True)]
        low, middle, high = (statistics.quantiles(ratios, n=4)[k] for k in range(3))
        cost = 1e6 * statistics.median(times)
        print(f"  {name:15} {cost:7.2f} us per image, {middle:5.2f} of C++ ({low:.2f}-{high:.2f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[64, 1024])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--shape", choices=["box", "cylinder"], default="box")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores, torch {torch.__version__}")
    with torch.inference_mode():
        for batch in options.batches:
            print(f"{options.shape}, batch {batch} (the floor always draws boxes):")
            compare(batch, options.rounds, options.shape)


if __name__ == "__main__":
    main()

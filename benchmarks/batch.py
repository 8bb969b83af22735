"""Many agents in one batch: cost of an agent-step, as a ratio to the same step in plain C++.

    python benchmarks/batch.py [--batches 256 4096] [--rounds 15]

The step is that of the agent without senses (`Direct`): behaviours, pairs, pulses, memory,
opposition, values. Four writings of it take turns in one run on one thread: the library's
modules (eager, and compiled where there is a C++ compiler), NumPy, and C++ (-O3), which is the
floor. First they must agree: after 400 steps from the same inputs, values to 1e-4. Prints the
median CPU time of an agent-step and its ratio to the floor, or to NumPy where no g++ is found.
A minute.
"""

import argparse
import ctypes
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from dntorch import DNSarsa
from dntorch.process import settle

SIZES = {"ui": 4, "uc": 4, "val": 4, "pulse": 16, "inhib": 16, "trace": 16, "opp": 16, "err": 1,
         "w": 16}  # fmt: skip
FLOOR = r"""
#include <cmath>
static inline float f(float u) { float x = 100 * u; return 0.5f + 0.5f * x / (1 + std::fabs(x)); }
struct Agent { float ui[4], uc[4], val[4], pulse[16], inhib[16], trace[16], opp[16], err, w[16]; };
extern "C" void step(Agent* agents, const float* match, const float* reward, const float* noise,
                     int batch, const float* base) {
  const float dt = 1 / 32.f;
  for (int b = 0; b < batch; b++) {
    Agent& a = agents[b];
    const float *m = match + 4 * b, *q = noise + 16 * b;
    float fi[4], fc[4], on[4], x[4], si = 0, sc = 0, sx = 0, drive[16], total = 0, sum = 0;
    for (int i = 0; i < 4; i++) {
      si += fi[i] = f(a.ui[i]); sc += fc[i] = f(a.uc[i]); on[i] = fc[i] > 0.5f;
    }
    for (int i = 0; i < 4; i++) {
      float y = 0;
      for (int j = 0; j < 4; j++) if (i != j) y += (a.w[4 * i + j] + q[4 * i + j]) * on[j];
      x[i] = std::fmax(std::fmax(y, 0.f) + base[i] * (1 - on[i]), 1e-9f); sx += x[i];
    }
    for (int i = 0; i < 4; i++) {
      float di = 20 * a.val[i] - 40 * fc[i], dc = 15 * m[i] - 2 * (si - fi[i]);
      a.ui[i] += dt / 0.3f * (-a.ui[i] - 5 + 10 * fi[i] - 30 * (si - fi[i]) + di);
      a.uc[i] += dt / 0.3f * (-a.uc[i] - 5 + 8 * fc[i] - 8 * (sc - fc[i]) + dc);
      a.val[i] += dt / 0.1f * (x[i] / sx - a.val[i]);
    }
    for (int k = 0; k < 16; k++) {
      total += drive[k] = 1.1f * (a.pulse[k] > 0.05f ? a.pulse[k] : 0) + 0.8f * a.trace[k];
      sum += a.opp[k];
    }
    float signal = 0.06f * (reward[b] + a.err);
    for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) {
      int k = 4 * i + j;
      float active = i != j && fi[i] * fc[j] > 0.5f, p = a.pulse[k];
      float gated = a.trace[k] > 0.01f ? a.w[k] : 0;
      float input = gated * (0.8f * (p > 0.05f) - (p < -0.05f));
      a.pulse[k] += dt / 0.5f * (active - p - a.inhib[k]);
      a.inhib[k] += dt / 0.5f * (active - a.inhib[k]);
      a.opp[k] += dt / 0.1f * (input - a.opp[k]);
      a.w[k] += dt * (1 - active) * a.trace[k] * signal;
      a.trace[k] += dt * (drive[k] - a.trace[k] * total);
    }
    a.err += dt / 0.1f * (sum - a.err);
  }
}
"""


def preference() -> np.ndarray:
    """What the value nodes suggest where nothing was learned."""
    nodes = DNSarsa(4).value_nodes
    return (nodes.baseline * nodes.ladder).numpy()


class Modules:
    """The library."""

    def __init__(self, batch: int, compiled: bool = False) -> None:
        agent = DNSarsa(4).spread(batch)
        self.state, self.noise = agent.state, torch.zeros(batch, 4, 4)
        self.run = (
            torch.compile(agent.step, fullgraph=True, dynamic=False) if compiled else agent.step
        )

    @torch.inference_mode()
    def step(self, match: np.ndarray, reward: np.ndarray) -> None:
        seen = {"match": torch.from_numpy(match)}
        inputs = seen, torch.from_numpy(reward), self.noise
        self.state = self.run(*inputs, self.state)[1]

    @property
    def weights(self) -> np.ndarray:
        return self.state.learner.values.weights.numpy()


class Arrays:
    """NumPy, batch first."""

    def __init__(self, batch: int) -> None:
        shapes = {"err": (batch,)} | {k: (batch, 4) for k in ("ui", "uc", "val")}
        self.s = {k: np.zeros(shapes.get(k, (batch, 4, 4)), np.float32) for k in SIZES}
        self.s["ui"] -= 5
        self.s["uc"] -= 5
        self.off = (1 - np.eye(4)).astype(np.float32)
        self.base = preference()
        self.noise = np.zeros((batch, 4, 4), np.float32)

    def step(self, match: np.ndarray, reward: np.ndarray) -> None:
        s, dt = self.s, np.float32(1 / 32)
        fi, fc = (0.5 + 0.5 * (x := 100 * s[k]) / (1 + np.abs(x)) for k in ("ui", "uc"))
        si, sc = fi.sum(-1, keepdims=True) - fi, fc.sum(-1, keepdims=True) - fc
        on = (fc > 0.5).astype(np.float32)
        y = np.matmul((s["w"] + self.noise) * self.off, on[..., None])[..., 0]
        x = np.maximum(np.maximum(y, 0) + self.base * (1 - on), 1e-9)
        drive = 20 * s["val"] - 40 * fc
        p, trace, w, err = s["pulse"], s["trace"], s["w"], s["err"]
        active = (fi[..., :, None] * fc[..., None, :] > 0.5) * self.off
        memory = 1.1 * np.where(p > 0.05, p, 0) + 0.8 * trace
        total = memory.sum((-2, -1), keepdims=True)
        signal = (0.06 * (reward + err))[..., None, None]
        gated = np.where(trace > 0.01, w, 0) * (0.8 * (p > 0.05) - (p < -0.05))
        self.s = {
            "ui": s["ui"] + dt / 0.3 * (-s["ui"] - 5 + 10 * fi - 30 * si + drive),
            "uc": s["uc"] + dt / 0.3 * (-s["uc"] - 5 + 8 * fc - 8 * sc + 15 * match - 2 * si),
            "val": s["val"] + dt / 0.1 * (x / x.sum(-1, keepdims=True) - s["val"]),
            "pulse": p + dt / 0.5 * (active - p - s["inhib"]),
            "inhib": s["inhib"] + dt / 0.5 * (active - s["inhib"]),
            "trace": trace + dt * (memory - trace * total),
            "opp": s["opp"] + dt / 0.1 * (gated - s["opp"]),
            "err": err + dt / 0.1 * (s["opp"].sum((-2, -1)) - err),
            "w": w + dt * (1 - active) * trace * signal,
        }
        self.s = {k: v.astype(np.float32, copy=False) for k, v in self.s.items()}

    @property
    def weights(self) -> np.ndarray:
        return self.s["w"]


class Floor:
    """C++, one agent after the other, all it needs in registers and cache."""

    def __init__(self, batch: int) -> None:
        with tempfile.TemporaryDirectory() as folder:
            source, library = Path(folder, "floor.cpp"), Path(folder, "floor.so")
            source.write_text(FLOOR)
            flags = ["-O3", "-march=native", "-fno-math-errno", "-shared", "-fPIC"]
            subprocess.run(["g++", *flags, source, "-o", library], check=True)
            self.call = ctypes.CDLL(str(library)).step
        self.agents = np.zeros((batch, sum(SIZES.values())), np.float32)
        self.agents[:, :8] = -5
        self.noise = np.zeros((batch, 16), np.float32)
        self.base = preference()

    def step(self, match: np.ndarray, reward: np.ndarray) -> None:
        pointers = (
            a.ctypes.data_as(ctypes.c_void_p) for a in (self.agents, match, reward, self.noise)
        )
        self.call(*pointers, len(match), self.base.ctypes.data_as(ctypes.c_void_p))

    @property
    def weights(self) -> np.ndarray:
        return self.agents[:, -16:].reshape(-1, 4, 4)


def inputs(batch: int, steps: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each second another object is in view for each agent; a reward now and then."""
    random = np.random.default_rng(0)
    seconds = range(-(-steps // 32))
    seen = [np.eye(4, dtype=np.float32)[random.integers(0, 4, batch)] for _ in seconds]
    paid = [2 * (random.random(batch) < 0.2).astype(np.float32) for _ in seconds]
    return [(seen[t // 32] * (t % 32 > 8), paid[t // 32]) for t in range(steps)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[256, 4096])
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    settle()
    ways: dict[str, Callable] = {"eager modules": Modules, "NumPy": Arrays}
    if shutil.which("g++"):
        ways |= {"compiled modules": lambda batch: Modules(batch, True), "C++": Floor}
    for batch in arguments.batches:
        compare(batch, ways, arguments.rounds)


def compare(batch: int, ways: dict[str, Callable], rounds: int) -> None:
    runs = {name: way(batch) for name, way in ways.items()}
    steps = inputs(batch, 400)
    for run in runs.values():
        for one in steps:
            run.step(*one)
    first = runs["eager modules"].weights
    for name, run in runs.items():
        apart = (np.abs(run.weights - first).max((-2, -1)) > 1e-4).mean()
        # Near ties are decided by rounding; what follows differs for good.
        assert apart < 0.02 and np.abs(first).max() > 0.01, (name, apart)
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            portion = steps[:40] if batch <= 1000 else steps[:10]
            began = time.process_time()
            for one in portion:
                run.step(*one)
            times[name].append((time.process_time() - began) / len(portion) / batch)
    medians = {name: statistics.median(values) for name, values in times.items()}
    floor = medians.get("C++", medians["NumPy"])
    print(f"batch {batch}: CPU time of an agent-step")
    for name, seconds in sorted(medians.items(), key=lambda item: item[1]):
        print(f"  {name:17} {1e9 * seconds:9.1f} ns {seconds / floor:7.1f} x")


if __name__ == "__main__":
    main()

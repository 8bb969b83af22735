"""Latency of one control step of the agent, from a camera image to wheel speeds, on one core.

    python benchmarks/latency.py [--rounds 40] [--pause 0.03] [--cpp build/cpp/run_agent]

Ways to run the same agent take turns within each round, so that a busy machine is busy for
all of them. Prints the median and the 99th percentile of wall time and of CPU time, which other
programs on the machine don't lengthen much, the share of the time between two control steps
(1/32 s) that the 99th percentile of wall time takes, and the ratio of median CPU times to the
eager agent. With --pause it sleeps before each step, as a control loop does: then caches are
cold. With --cpp also what the C++ runner says of itself. Takes about half a minute, with
--aotinductor one more. For real-time priority: chrt -f 10 python benchmarks/latency.py.
"""

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from dntorch import DNSarsa, FindColor
from dntorch.export import RUNTIMES, replay
from dntorch.process import settle
from dntorch.runs.config import Config
from dntorch.runs.export import export_run
from dntorch.runs.run import Trial

ROUNDS, STEPS, WARM = 40, 50, 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of {STEPS} steps each")
    parser.add_argument("--pause", type=float, default=0.0, help="seconds before each step")
    parser.add_argument("--aotinductor", action="store_true")
    parser.add_argument("--cpp", type=Path, help="the C++ runner that `make cpp` builds")
    options = parser.parse_args()
    settle()
    runtimes = ["torchscript", "export", "onnx"] + ["aotinductor"] * options.aotinductor
    with tempfile.TemporaryDirectory() as folder:
        export = untrained(Path(folder), runtimes)
        manifest, golden = replay.read(export)
        inputs = [golden[f"run/{port['name']}"] for port in manifest["inputs"]]
        steppers = {"eager": eager(*inputs)}
        for runtime in runtimes:
            path = export / f"agent{RUNTIMES[runtime]}"
            steppers[runtime] = artefact(runtime, path, manifest, inputs)
        print(f"load of the last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs")
        report(measure(steppers, options.rounds, options.pause), manifest["dt"])
        if options.cpp:
            done = subprocess.run([options.cpp, export, "20"], capture_output=True, text=True)
            print("C++", *done.stdout.splitlines()[-2:], done.stderr, sep="\n")


def untrained(folder: Path, runtimes: list[str]) -> Path:
    """An export of an agent that knows nothing yet, which costs the same."""
    trial = Trial(Config(steps=1, explore=0))
    trial.save(folder / "checkpoint.pt")
    trial.close()
    return export_run(folder, folder / "export", runtimes)


def eager(*inputs):
    agent, (image, reward, noise) = DNSarsa(4, FindColor()), map(torch.from_numpy, inputs)

    def step(k: int) -> None:
        with torch.inference_mode():
            agent({"image": image[k]}, reward[k], noise[k])

    return step


def artefact(runtime: str, path: Path, manifest: dict, inputs):
    """The artefact itself, without the copies and comparisons of `replay`."""
    held = replay.RUNTIMES[runtime](path, manifest)
    tensors = [torch.from_numpy(x) for x in inputs]
    if runtime == "torchscript":

        def step(k: int) -> None:
            with torch.inference_mode():
                held.module(*(x[k] for x in tensors))

        return step
    if runtime == "onnx":
        names = held.takes[len(inputs) + 1 :]
        state = dict(zip(names, held.held.values()))
        learning = {held.takes[len(inputs)]: np.ones((), np.float32)}

        def step(k: int) -> None:
            now = {name: np.asarray(x[k]) for name, x in zip(held.takes, inputs)}
            _, *after = held.session.run(None, now | learning | state)
            state.update(zip(names, after))

        return step
    loop = [torch.from_numpy(x) for x in held.held.values()]

    def step(k: int) -> None:
        with torch.no_grad():
            _, *loop[:] = held.function(*(x[k] for x in tensors), torch.ones(()), *loop)

    return step


def measure(steppers, rounds: int, pause: float) -> dict[str, np.ndarray]:
    """Milliseconds of each step for each way, in turns: wall time and CPU time, ``(2, steps)``."""
    times = {name: [] for name in steppers}
    for turn in range(-(WARM // STEPS), rounds):
        for name, step in steppers.items():
            for k in range(STEPS):
                if pause:
                    time.sleep(pause)
                began = time.perf_counter(), time.thread_time()
                step((turn * STEPS + k) % 800)
                ended = time.perf_counter(), time.thread_time()
                if turn >= 0:
                    times[name].append(1e3 * np.subtract(ended, began))
    return {name: np.array(values).T for name, values in times.items()}


def report(times: dict[str, np.ndarray], dt: float) -> None:
    columns = ("median", "p99", "CPU median", "CPU p99", "of 1/32 s", "eager/this")
    print(" " * 12 + "".join(f"{column:>12}" for column in columns))
    eager = np.median(times["eager"][1])
    for name, (wall, cpu) in times.items():
        numbers = [np.quantile(x, q) for x in (wall, cpu) for q in (0.5, 0.99)]
        cells = "".join(f"{number:9.3f} ms" for number in numbers)
        share, ratio = numbers[1] / 1e3 / dt, eager / numbers[2]
        print(f"{name:12}{cells}{share:12.1%}{ratio:12.2f}")


if __name__ == "__main__":
    main()

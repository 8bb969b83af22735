"""What all benchmarks share: one thread, ways that take turns, ratios with their spread.

A way is a function without arguments that does a portion of steps. Ways take turns in rounds of
one run, since a shared machine is slow at one moment and fast at the next; the ratio of a round
compares neighbours in time. Printed are medians over the rounds and, of the ratios, the range
that holds four fifths of them.
"""

import ctypes
import os
import platform
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch

CXX = "g++"
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-shared", "-fPIC")


def has_compiler() -> bool:
    return shutil.which(CXX) is not None


def build(source: str) -> ctypes.CDLL:
    """A library from C++ source."""
    with tempfile.TemporaryDirectory() as folder:
        file, library = Path(folder, "floor.cpp"), Path(folder, "floor.so")
        file.write_text(source)
        subprocess.run([CXX, *FLAGS, file, "-o", library], check=True)
        return ctypes.CDLL(str(library))


def address(array) -> ctypes.c_void_p:
    """Where a NumPy array begins, for a function in C."""
    return array.ctypes.data_as(ctypes.c_void_p)


def machine() -> str:
    """Processor, load and versions, for the head of a table."""
    processor = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next((x.split(": ")[1] for x in lines if x.startswith("model name")), processor)
    load = " ".join(f"{x:.1f}" for x in os.getloadavg())
    return (
        f"{processor}, {os.cpu_count()} cores, load {load}, {torch.get_num_threads()} thread, "
        f"torch {torch.__version__}, Python {platform.python_version()}"
    )


def take_turns(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of each way in each round; one call of each before is not counted."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    for way in ways.values():
        way()
    for _ in range(rounds):
        for name, way in ways.items():
            began = time.process_time()
            way()
            times[name].append(time.process_time() - began)
    return times


def ratios(times: list[float], floor: list[float]) -> tuple[float, float, float]:
    """Median and the ends of the middle four fifths of the ratios, round by round."""
    each = sorted(a / b for a, b in zip(times, floor))
    tenth = len(each) // 10
    return statistics.median(each), each[tenth], each[-1 - tenth]


def table(title: str, times: dict[str, list[float]], floor: str, work: dict[str, float]) -> None:
    """Print time per unit of ``work`` and ratio to ``floor``, fastest first."""
    print(f"\n{title}\n  {machine()}")
    unit = {name: [t / work[name] for t in each] for name, each in times.items()}
    for name in sorted(unit, key=lambda name: statistics.median(unit[name])):
        middle, low, high = ratios(unit[name], unit[floor])
        micro = 1e6 * statistics.median(unit[name])
        print(
            f"  {name:26} {micro:12.3f} us {middle:9.2f} x  ({low:.2f} to {high:.2f})", flush=True
        )

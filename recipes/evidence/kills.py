"""Does a killed run lose anything? Kills at any moment, and single bits of a checkpoint flipped.

For each world and each signal (KILL, TERM, INT, HUP) one run of ``dntorch learn`` is begun,
killed 20 times, each time a moment after it has saved, and resumed to its end. You see whether
what it saved at last is, to the last bit, that of a run that nobody killed. Then single bits of
that checkpoint are flipped, at 300 places: each must be refused. About 40 minutes on two cores,
most of them the start of processes.

    python recipes/evidence/kills.py --kills 20 --flips 300 --out runs/kills
"""

import argparse
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch

from dntorch import files
from dntorch.runs.train import CHECKPOINT

WORLDS, SIGNALS = ("epuck", "ring", "nodes"), ("KILL", "TERM", "INT", "HUP")
LIFE, SAVE_EVERY = 150, 20
"""Control steps: of the run per kill, more than it gets on; from one checkpoint to the next."""
LATEST = 0.05
"""s, from a save to the latest moment at which a signal comes."""
PATIENCE = 300.0
"""s, for a process to come to its next checkpoint."""


def learn(*arguments: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "dntorch.cli", "learn", "--no-video", "--checkpoint-every"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([*command, str(SAVE_EVERY), *map(str, arguments)], **quiet)


def saved(path: Path) -> int:
    """When a checkpoint that had one before it was saved, 0 if there is none such."""
    return path.stat().st_mtime_ns if files.before(path).exists() else 0


def kill(process: subprocess.Popen, number: int, path: Path, moment: float) -> None:
    """Send a signal a moment after the process has saved once more."""
    known, until = saved(path), time.monotonic() + PATIENCE
    while saved(path) in (0, known):
        assert process.poll() is None, f"it ended before it could be killed: {process.returncode}"
        assert time.monotonic() < until, f"no checkpoint within {PATIENCE} s"
        time.sleep(0.001)
    time.sleep(moment)
    process.send_signal(number)
    ended = process.wait(timeout=PATIENCE)
    assert ended == (-number if number == signal.SIGKILL else 130), f"it ended with {ended}"


def same(a: object, b: object) -> bool:
    """Whether nested contents are equal to the last bit."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


def refused(path: Path, places: int, chance: random.Random) -> int:
    """How many of so many copies with one bit flipped are refused in one sentence."""
    whole, count = path.read_bytes(), 0
    copy = path.with_name("flipped.pt")
    for place in chance.sample(range(len(whole)), places):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << chance.randrange(8)
        copy.write_bytes(damaged)
        try:
            files.load(copy)
        except ValueError as error:
            count += "\n" not in str(error)
    copy.unlink()
    return count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20, help="for each signal in each world")
    parser.add_argument("--flips", type=int, default=300, help="places of a checkpoint")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=WORLDS)
    parser.add_argument("--signals", nargs="+", choices=SIGNALS, default=SIGNALS)
    parser.add_argument("--out", type=Path, default=Path("runs/kills"), help="an empty folder")
    a = parser.parse_args()

    for number in (signal.SIGINT, signal.SIGHUP):  # ignored in the background and under nohup
        signal.signal(number, signal.SIG_DFL)
    chance, failed = random.Random(0), 0
    steps = LIFE * (a.kills + 1)
    for world in a.worlds:
        options = ["--world", world, "--steps", steps, "--explore", steps * 3 // 4]
        whole = a.out / world / "whole"
        assert learn(*options, "--out", whole).wait() == 0, f"{whole} holds a run: name another"
        expected = files.load(whole / CHECKPOINT)
        for name in a.signals:
            folder = a.out / world / name.lower()
            process = learn(*options, "--out", folder)
            for _ in range(a.kills):
                kill(process, getattr(signal, f"SIG{name}"), folder / CHECKPOINT,
                     chance.uniform(0, LATEST))  # fmt: skip
                process = learn("--resume", folder)
            assert process.wait() == 0, f"{folder} could not be resumed"
            left = [path.name for path in folder.glob(".*")]
            equal = same(files.load(folder / CHECKPOINT), expected) and not left
            failed += not equal
            print(f"{world} {name}: {a.kills} kills, bit-identical: {equal}", flush=True)
        count = refused(whole / CHECKPOINT, a.flips, chance)
        failed += count < a.flips
        print(f"{world}: {a.flips} bits flipped, {count} refused", flush=True)
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()

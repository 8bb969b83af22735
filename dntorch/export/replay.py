"""Replay a golden record through exported artefacts. Runs without dntorch.

    python verify.py [--trust] [DIR]

For each artefact in DIR it prints the largest difference to the eager original for each
output, step by step from recorded states and running freely, and a verdict. The exit code
is 1 when one fails, 2 when DIR holds no export. Needs NumPy, and PyTorch, ONNX Runtime or
ExecuTorch for the artefacts at hand. Native code is loaded only with --trust. Checksums tell
damage, not who sent it.
"""

import contextlib
import sys
from pathlib import Path

import numpy as np

from dntorch.export.reading import NoExport, Unfit, at_rest, read, steps, untouched
from dntorch.export.runtimes import LOADERS
from dntorch.export.trust import check_safe

# ---------------------------------------------------------------- what is compared


def difference(actual, expected):
    """Largest difference, relative for numbers above one; infinite for another shape."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    if actual.shape != expected.shape or actual.dtype != expected.dtype:
        return np.inf
    if actual.size == 0:
        return 0.0
    expected = expected.astype(np.float64)
    gap = np.abs(actual.astype(np.float64) - expected) / np.maximum(1.0, np.abs(expected))
    return float(np.nan_to_num(gap, nan=np.inf).max())


class Worst(dict):
    """The largest difference seen for each name."""

    def see(self, actual, expected):
        for name, value in expected.items():
            self[name] = max(self.get(name, 0.0), difference(actual[name], value))


def rows(record, part, ports, prefix=""):
    """Function that gives the named arrays of a part of the record at one row."""
    arrays = {p["name"]: record[f"{part}/{prefix}{p['name']}"] for p in ports}
    # A number of its own is a 0-d array, not a NumPy scalar.
    return lambda k: {name: np.asarray(array[k]) for name, array in arrays.items()}


def stepwise(artefact, manifest, record):
    """Single steps from recorded states."""
    worst, count = Worst(), len(record["pairs/step"])
    part = {
        key: rows(record, "pairs", manifest[ports], prefix)
        for key, ports, prefix in (
            ("inputs", "inputs", ""), ("switches", "switches", ""), ("outputs", "outputs", ""),
            ("state", "state", "state."), ("next", "state", "next."),
        )
    }  # fmt: skip
    for k in range(count):
        artefact.set(part["state"](k))
        worst.see(artefact.step(part["inputs"](k), part["switches"](k)), part["outputs"](k))
        worst.see(artefact.state(), part["next"](k))
    return worst


def freely(artefact, manifest, record):
    """The whole run from the artefact's own state at rest; also what it decided, and where."""
    worst, decided = Worst(), {name: ([], []) for name in manifest["thresholds"]}
    inputs = rows(record, "run", manifest["inputs"])
    switches = rows(record, "run", manifest["switches"])
    outputs = rows(record, "run", manifest["outputs"])
    small = [p for p in manifest["state"] if f"run/next.{p['name']}" in record]
    state = rows(record, "run", small, "next.")
    for k in range(steps(manifest, record)):
        worst.see(artefact.step(inputs(k), switches(k)), outputs(k))
        actual, expected = artefact.state(), state(k)
        worst.see(actual, expected)
        for name, both in decided.items():
            for decisions, values in zip(both, (actual, expected)):
                on = tuple(values[name] > manifest["thresholds"][name])
                if not decisions or decisions[-1] != on:
                    decisions.append(on)
    return worst, [name for name, (ours, theirs) in decided.items() if ours != theirs]


def check(artefact, runtime, manifest, record):
    """Lines to print, and what is wrong."""
    tolerance = manifest["tolerance"]
    step_limit = tolerance.get(runtime, tolerance["step"])
    lines, wrong = [], []
    ports, start = manifest["state"], Worst()
    first = rows(record, "start", ports)(0)
    start.see(artefact.state(), first)
    start.see({port["name"]: at_rest(port) for port in ports}, first)
    wrong += [f"{name} starts elsewhere, by {gap:.1e}" for name, gap in start.items() if gap > 0]
    free, undecided = freely(artefact, manifest, record)
    single = stepwise(artefact, manifest, record)
    wrong += [f"{n} differs by {g:.1e} in one step" for n, g in single.items() if g > step_limit]
    wrong += [f"{name} decides otherwise" for name in undecided]
    # Transitions amplify rounding: fields may differ for some steps; what was learned and what
    # was counted may not.
    lasting = [p["name"] for p in manifest["state"] if p["lasting"]]
    lasting = lasting if manifest["thresholds"] else list(free)
    wrong += [
        f"{name} differs by {free[name]:.1e} running freely"
        for name in lasting
        if free.get(name, 0.0) > tolerance["free"]
    ]
    for name, gap in single.items():
        alone = f"{free[name]:.1e}" if name in free else "-"
        lines.append(f"  {name:36} {gap:12.1e} {alone:>12}")
    return lines, wrong


# ---------------------------------------------------------------- the program


def verify(folder, trust=False):
    """Check all, native code only if it is trusted; returns whether all is well."""
    folder = Path(folder)
    manifest, record = read(folder)
    pairs = len(record["pairs/step"])
    print(
        f"{manifest['name']} ({manifest['structure']}): {pairs} steps from recorded states, "
        f"{steps(manifest, record)} running freely; largest differences:"
    )
    well = True
    for name, entry in manifest["files"].items():
        lines, wrong = [], []
        try:
            untouched(folder, name, entry)
            if "runtime" in entry:
                if entry["runtime"] not in [*LOADERS]:
                    raise Unfit(f"is for {entry['runtime']!r}: known are {', '.join(LOADERS)}")
                check_safe(folder / name, entry["runtime"], trust)
                artefact = LOADERS[entry["runtime"]](folder / name, manifest)
                lines, wrong = check(artefact, entry["runtime"], manifest, record)
        except ImportError as error:
            wrong = [f"{error}: install it, or delete the entry"]
        except Exception as error:
            wrong = [str(error).strip().splitlines()[-1] if str(error).strip() else repr(error)]
        if lines:
            print(f"{name}\n  {'':36} {'step by step':>12} {'freely':>12}")
            print("\n".join(lines))
        print(f"{name}: {'FAILED: ' + '; '.join(wrong) if wrong else 'ok'}")
        well = well and not wrong
    return well


def main():
    sys.modules["dntorch"] = None  # from here on it can't be imported, installed or not
    with contextlib.suppress(ImportError):
        import torch

        torch.set_num_threads(1)  # more are slower for so few numbers
    given = [argument for argument in sys.argv[1:] if argument != "--trust"]
    folder = Path(given[0] if given else Path(__file__).parent)
    try:
        sys.exit(0 if verify(folder, "--trust" in sys.argv) else 1)
    except Unfit as error:
        print(f"verify: {error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, NoExport) else 1)


if __name__ == "__main__":
    main()

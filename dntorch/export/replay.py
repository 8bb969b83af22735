"""Replay a golden record through exported artefacts. Runs without dntorch.

    python verify.py [DIR]

For each artefact in DIR it prints the largest difference to the eager original for each
output, step by step from recorded states and running freely, and a verdict. The exit code
is 1 when one fails. Needs NumPy, and PyTorch, ONNX Runtime or ExecuTorch for the artefacts
at hand.
"""

import contextlib
import hashlib
import io
import json
import sys
from pathlib import Path

import numpy as np

FORMAT = 3
MANIFEST, GOLDEN = "manifest.json", "golden.npz"
KEYS = ("name", "dt", "inputs", "switches", "outputs", "state", "files", "tolerance", "thresholds")


class Unfit(Exception):
    """An artefact, a manifest or a record that can't be used; says why."""


# ---------------------------------------------------------------- artefacts behind one face


class Script:
    """TorchScript, which holds its state."""

    def __init__(self, path, manifest):
        import torch

        self.torch, self.module = torch, torch.jit.load(path)
        self.outputs = [port["name"] for port in manifest["outputs"]]
        self.switches = {port["name"]: float(port["rest"]) for port in manifest["switches"]}

    def state(self):
        return {k: v.numpy().copy() for k, v in self.module.get_state().items()}

    def set(self, state):
        self.module.set_state({k: self.torch.from_numpy(v.copy()) for k, v in state.items()})

    def step(self, inputs, switches):
        for name, value in switches.items():
            if self.switches[name] != float(value):
                self.module.learn(bool(value))
                self.switches[name] = float(value)
        output = self.module(*(self.torch.from_numpy(x.copy()) for x in inputs.values()))
        output = output if isinstance(output, tuple) else (output,)
        return dict(zip(self.outputs, (x.detach().numpy() for x in output)))


class Function:
    """A pure function: the state is held here, and starts as the manifest says."""

    def __init__(self, path, manifest):
        self.outputs = [port["name"] for port in manifest["outputs"]]
        self.names = [port["name"] for port in manifest["state"]]
        self.held = {port["name"]: at_rest(port) for port in manifest["state"]}
        self.load(path)

    def state(self):
        return dict(self.held)

    def set(self, state):
        self.held = {name: state[name] for name in self.names}

    def step(self, inputs, switches):
        gives = self.call([*inputs.values(), *switches.values(), *self.held.values()])
        count = len(self.outputs)
        self.held = dict(zip(self.names, gives[count:]))
        return dict(zip(self.outputs, gives[:count]))


class Torch(Function):
    """All that takes and gives torch tensors."""

    def call(self, arrays):
        import torch

        with torch.no_grad():
            tensors = self.function(*(torch.from_numpy(x.copy()) for x in arrays))
        return [tensor.numpy() for tensor in tensors]


class Export(Torch):
    def load(self, path):
        import torch

        self.function = torch.export.load(path).module()


class AOTInductor(Torch):
    def load(self, path):
        import torch

        self.function = torch._inductor.aoti_load_package(str(path))


class ExecuTorch(Torch):
    def load(self, path):
        from executorch.runtime import Runtime

        method = Runtime.get().load_program(str(path)).load_method("forward")
        self.function = lambda *tensors: method.execute(list(tensors))


class Onnx(Function):
    def load(self, path):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        self.takes = [port.name for port in self.session.get_inputs()]

    def call(self, arrays):
        if len(arrays) != len(self.takes):
            raise Unfit(f"takes {len(self.takes)} tensors, the manifest names {len(arrays)}")
        return self.session.run(None, dict(zip(self.takes, arrays)))


RUNTIMES = {
    "torchscript": Script,
    "export": Export,
    "onnx": Onnx,
    "aotinductor": AOTInductor,
    "executorch": ExecuTorch,
}


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


def steps(manifest, record):
    return len(record[f"run/{manifest['inputs'][0]['name']}"])


def at_rest(port):
    return np.broadcast_to(np.array(port["rest"], port["dtype"]), port["shape"]).copy()


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


def read(folder):
    """Manifest and golden record."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text())
        if manifest.get("format") != FORMAT:
            raise Unfit(
                f"{MANIFEST} is of format {manifest.get('format')}, not {FORMAT}: export again"
            )
        missing = [key for key in KEYS if key not in manifest]
        if missing:
            raise Unfit(f"{MANIFEST} lacks {missing}: export again")
    except FileNotFoundError:
        raise Unfit(f"{folder / MANIFEST} does not exist: name a folder of an export") from None
    except (ValueError, AttributeError) as error:
        raise Unfit(f"{MANIFEST} is damaged ({error}): export again") from None
    try:
        record = dict(np.load(io.BytesIO((folder / GOLDEN).read_bytes())))
    except Exception as error:
        raise Unfit(f"{GOLDEN} is damaged ({error}): export again") from None
    return manifest, record


def untouched(folder, name, entry):
    """Raise unless a file is the one that was exported."""
    try:
        content = (folder / name).read_bytes()
    except OSError as error:
        raise Unfit(f"cannot be read ({error.strerror})") from None
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise Unfit(
            f"is not the file that was exported: {len(content)} bytes with another checksum than "
            f"that of {entry['bytes']} bytes in {MANIFEST}"
        )


def verify(folder):
    """Check all; returns whether all is well."""
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
                artefact = RUNTIMES[entry["runtime"]](folder / name, manifest)
                lines, wrong = check(artefact, entry["runtime"], manifest, record)
        except ImportError as error:
            wrong = [f"{error}: install it, or delete the entry"]
        except Exception as error:
            wrong = [str(error).strip().splitlines()[-1] if str(error) else repr(error)]
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
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    try:
        sys.exit(0 if verify(folder) else 1)
    except Unfit as error:
        sys.exit(f"verify: {error}")


if __name__ == "__main__":
    main()

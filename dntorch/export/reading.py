"""What an export says of itself: its manifest and its golden record, checked before use.

A part of ``verify.py``: imports nothing that is not there without dntorch.
"""

import hashlib
import io
import json
import math
import re
import zipfile

import numpy as np

FORMAT = 3
MANIFEST, GOLDEN = "manifest.json", "golden.npz"
TOLERANCE = {"step": 1e-6, "onnx": 5e-6, "aotinductor": 1e-5, "executorch": 1e-5, "free": 1e-4}
"""What an export may allow at most. ONNX adds in another order: of terms of the size 30, as those
of recall, the sum may be otherwise by 4e-6."""
KINDS = {
    "name": str, "structure": str, "dt": (int, float), "inputs": list, "switches": list,
    "outputs": list, "state": list, "files": dict, "tolerance": dict, "thresholds": dict,
}  # fmt: skip
"""What a manifest must have."""
DTYPES = ("float64", "float32", "float16", "uint8", "int8", "int16", "int32", "int64", "bool")
LARGEST = 1 << 30
"""Bytes of a record, unpacked, at most."""


ABSENT = "{} does not exist: name a folder of an export"


class Unfit(Exception):
    """An artefact, a manifest or a record that can't be used; says why."""


class NoExport(Unfit):
    """A folder that holds none."""


def content_of(folder, name):
    """Bytes of a file that lies in the folder itself."""
    path = folder / name
    if name in ("", ".", "..") or re.search(r"[/\\:\0]", name):
        raise Unfit("lies outside the folder: name a file in it")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise Unfit("is a link or a device, not a file: copy the file itself there")
    try:
        return path.read_bytes()
    except OSError as error:
        raise Unfit(f"cannot be read ({error.strerror})") from None


def read(folder):
    """Manifest and golden record."""
    if not (folder / MANIFEST).exists():
        raise NoExport(ABSENT.format(folder / MANIFEST))
    try:
        manifest = json.loads(content_of(folder, MANIFEST))
        if manifest.get("format") != FORMAT:
            raise Unfit(f"is of format {manifest.get('format')}, not {FORMAT}")
        check_manifest(manifest)
    except Unfit as error:
        raise Unfit(f"{MANIFEST} {error}: export again") from None
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise Unfit(f"{MANIFEST} is damaged ({reason}): export again") from None
    try:
        record = unpacked(content_of(folder, GOLDEN))
        check_record(manifest, record)
    except Exception as error:
        raise Unfit(f"{GOLDEN} is damaged ({error}): export again") from None
    for port in (*manifest["switches"], *manifest["state"]):
        try:
            at_rest(port)  # of a shape that the record has, so not of any size
        except (KeyError, TypeError, ValueError):
            raise Unfit(f"{MANIFEST} has no rest value of {port['name']}: export again") from None
    return manifest, record


def unpacked(content):
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(member.file_size for member in archive.infolist()) > LARGEST:
            raise Unfit(f"more than {LARGEST} bytes")
    return dict(np.load(io.BytesIO(content)))


def check_manifest(manifest):
    """Raise unless all that is read below is there, of its kind and within limits."""
    for key, kind in KINDS.items():
        if not isinstance(manifest.get(key), kind):
            raise Unfit(f"lacks {key}, or has another kind of it")
    if not is_number(manifest["dt"]) or manifest["dt"] <= 0:
        raise Unfit(f"says dt={manifest['dt']!r}")
    for key in ("inputs", "outputs"):
        if not manifest[key]:
            raise Unfit(f"names no {key}")
    ports = [port for key in ("inputs", "switches", "outputs", "state") for port in manifest[key]]
    for port in ports:
        shape = port["shape"]
        if not (isinstance(port["name"], str) and port["dtype"] in DTYPES):
            raise Unfit(f"has a port {port['name']!r} of dtype {port['dtype']!r}")
        if not all(type(size) is int and size >= 0 for size in shape):
            raise Unfit(f"has a port {port['name']} of shape {shape!r}")
    if len({port["name"] for port in ports}) < len(ports):
        raise Unfit("names two ports alike")
    state = {port["name"]: port for port in manifest["state"]}
    for port in state.values():
        if not isinstance(port["lasting"], bool):
            raise Unfit(f"says {port['lasting']!r} for whether {port['name']} lasts")
    for name, value in manifest["thresholds"].items():
        if name not in state or not is_number(value):
            raise Unfit(f"has a threshold {value!r} of {name}")
    if not {"step", "free"} <= manifest["tolerance"].keys():
        raise Unfit("lacks a tolerance")
    for name, value in manifest["tolerance"].items():
        if name not in TOLERANCE or not is_number(value) or not 0 <= value <= TOLERANCE[name]:
            raise Unfit(f"allows a tolerance of {value!r} for {name}, more than {TOLERANCE}")
    entries = manifest["files"].values()
    if not any(isinstance(entry, dict) and "runtime" in entry for entry in entries):
        raise Unfit("lists no artefact")


def is_number(value):
    return type(value) in (int, float) and math.isfinite(value)


def check_record(manifest, record):
    """Raise unless a record has a row of each port for each step, and a step at all."""
    inputs, state = (*manifest["inputs"], *manifest["switches"]), manifest["state"]
    parts = {
        "start/": state, "run/": (*inputs, *manifest["outputs"]),
        "pairs/": (*inputs, *manifest["outputs"]), "pairs/state.": state, "pairs/next.": state,
    }  # fmt: skip
    count = {"start": 1, "run": steps(manifest, record), "pairs": len(record["pairs/step"])}
    if min(count.values()) < 1:
        raise Unfit("it has no steps")
    asked = [(prefix + port["name"], port) for prefix, part in parts.items() for port in part]
    asked += [(name, port) for port in state if (name := f"run/next.{port['name']}") in record]
    for name, port in asked:
        array, shape = record[name], (count[name.partition("/")[0]], *port["shape"])
        if (str(array.dtype), array.shape) != (port["dtype"], shape):
            raise Unfit(f"{name} is {array.dtype} {array.shape}, not {port['dtype']} {shape}")
    for name in manifest["thresholds"]:
        if f"run/next.{name}" not in record:
            raise Unfit(f"run/next.{name} is not in it")


def untouched(folder, name, entry):
    """Raise unless a file is the one that was exported."""
    if not isinstance(entry, dict) or not isinstance(entry.get("sha256"), str):
        raise Unfit(f"has no checksum in {MANIFEST}")
    content = content_of(folder, name)
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise Unfit(
            f"is not the file that was exported: {len(content)} bytes with another checksum than "
            f"that of {entry.get('bytes')} bytes in {MANIFEST}"
        )


def steps(manifest, record):
    return len(record[f"run/{manifest['inputs'][0]['name']}"])


def at_rest(port):
    return np.broadcast_to(np.array(port["rest"], port["dtype"]), port["shape"]).copy()

"""What of an export may be loaded: artefacts that do nothing but compute on tensors.

An artefact is a program. Before one is loaded it must look as the exporter writes it: no pickle
that could run code, no Python expression, no operation that writes files. Native code is loaded
only when its sender is trusted.

A part of ``verify.py``: imports nothing that is not there without dntorch.
"""

import io
import json
import pickletools
import re
import zipfile

from dntorch.export.reading import Unfit

OF_PROGRAM = re.compile(
    r"models/model\.json|data/sample_inputs/model\.pt|data/weights/(weight_\d+|model_weights_config"
    r"\.json)|data/constants/(tensor_\d+|model_constants_config\.json)|\.?\w+|\.data/\w+"
)
"""Members of a ``torch.export`` archive that holds no pickle but its example."""
OF_SCRIPT = re.compile(
    r"code/[\w/]+\.py(\.debug_pkl)?|(data|constants)(\.pkl|/\d+)|\.?\w+|\.data/\w+"
)
WORD = re.compile(r"[\w.+-]*")
OPERATION = re.compile(r"torch\.ops\.aten\.(\w+)\.(\w+)")
REACHES_OUT = re.compile(r"\b(save|from_file)\s*\(|\bops\.(?!prim\.|aten\.)|\btorch\.classes\b")
"""In TorchScript: operations that write or map files, those of others, native classes."""
GLOBALS = re.compile(
    r"__torch__\.[\w.]+ \w+|torch \w+Storage|torch\._utils _rebuild_\w+|torch\.jit\._pickle \w+"
    r"|collections OrderedDict"
)
"""What the pickles of TorchScript name; its own reader imports no Python."""


def members(path, known):
    """Members of an archive of PyTorch by name; raise for one that no export has."""
    import torch

    reader = torch._C.PyTorchFileReader(str(path))  # as the loader sees it
    names = reader.get_all_records()
    with zipfile.ZipFile(path) as archive:  # as others see it
        seen = {name.partition("/")[2]: archive.read(name) for name in archive.namelist()}
        if sorted(names) != sorted(n.partition("/")[2] for n in archive.namelist()):
            raise Unfit("is an archive that two readers read differently: not loaded")
    for name in names:
        if not known.fullmatch(name):
            raise Unfit(f"holds {name}, which no export has and which could be code: not loaded")
        if reader.get_record(name) != seen[name]:
            raise Unfit(f"holds two members {name}: not loaded")
    return seen


def check_program(path):
    """Raise unless a ``torch.export`` archive has nothing that its loader would run as Python."""
    import torch

    held = members(path, OF_PROGRAM)
    for part in ("weights", "constants"):
        for key, value in leaves(json.loads(held[f"data/{part}/model_{part}_config.json"])):
            if key == "use_pickle" and value is not False:
                raise Unfit(f"holds a pickle among its {part}, which could be code: not loaded")
    try:
        torch.load(io.BytesIO(held["data/sample_inputs/model.pt"]), weights_only=True)
    except Exception:
        raise Unfit(
            "holds a pickle of more than tensors as its example, which could be code: not loaded"
        ) from None
    for key, value in leaves(json.loads(held["models/model.json"])):
        if key in ("expr_str", "guards_code"):
            raise Unfit("holds a Python expression, which could be any code: not loaded")
        if key == "target":
            check_operation(value)
        elif key in ("in_spec", "out_spec"):
            for kind, content in leaves(json.loads(value)):
                if kind == "type" and content not in (None, "builtins.tuple", "builtins.dict"):
                    raise Unfit(f"takes or gives a {content}, not tensors: not loaded")
        elif key != "as_string" and isinstance(value, str) and not WORD.fullmatch(value):
            raise Unfit(f"holds {value[:40]!r} where a name belongs: not loaded")


def check_operation(target):
    import torch

    operation = OPERATION.fullmatch(target)
    found = target == "_operator.getitem"
    if operation and operation[1] != "from_file":
        packet = getattr(torch.ops.aten, operation[1], None)
        found = isinstance(getattr(packet, operation[2], None), torch._ops.OpOverload)
    if not found:
        raise Unfit(f"calls {target[:80]}, which is no operation on tensors: not loaded")


def leaves(value, key=""):
    """What lies in nested JSON, with the key above it; without notes on where nodes came from."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield "", name
            if name != "metadata":
                yield from leaves(one, name)
    elif isinstance(value, list):
        for one in value:
            yield from leaves(one, key)
    else:
        yield key, value


def check_script(path):
    """Raise unless a TorchScript archive keeps to tensors."""
    for name, content in members(path, OF_SCRIPT).items():
        if name.endswith(".py"):
            if found := REACHES_OUT.search(content.decode()):
                raise Unfit(f"calls {found[0]!r}, which reaches beyond tensors: not loaded")
        elif name.endswith("pkl"):
            for operation, argument, _ in pickletools.genops(content):
                if operation.name in ("STACK_GLOBAL", "INST", "EXT1", "EXT2", "EXT4") or (
                    operation.name == "GLOBAL" and not GLOBALS.fullmatch(argument)
                ):
                    raise Unfit(f"holds a pickle that names {argument}: not loaded")


NATIVE = ("aotinductor",)
CHECKS = {"export": check_program, "torchscript": check_script}
DATA = ("onnx", "executorch")
"""Formats that their runtimes only compute with."""


def check_safe(path, runtime, trust):
    """Raise for what could do more than compute when it is loaded."""
    if runtime in NATIVE and not trust:
        raise Unfit("is native code: give --trust if you know who made it")
    if runtime not in (*NATIVE, *DATA):
        CHECKS[runtime](path)

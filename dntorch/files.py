"""Files that are whole or absent: checkpoints of tensors and arrays, and results as JSON."""

import json
import os
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch

FORMAT = 2
UMASK = os.umask(0o077)
os.umask(UMASK)


def write_atomically(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write a file under another name, flush it to disk, then give it its own.

    Killed at any moment, ``path`` holds the old content or the new, never a part.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        os.chmod(temporary, 0o666 & ~UMASK)  # as other files; mkstemp makes private ones
        with os.fdopen(handle, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def save(path: Path, content: dict[str, Any]) -> None:
    """Save numbers, strings, tensors, arrays and bytes in nested dicts and lists."""
    plain = _map(content, _pack) | {"format": FORMAT}
    write_atomically(path, lambda file: torch.save(plain, file))


def load(path: Path) -> dict[str, Any]:
    """Load what `save` saved, without running any code that the file might bring.

    Raises:
        ValueError: there is no checkpoint, or it is damaged or of another version.
    """
    try:
        content = torch.load(path, weights_only=True, map_location="cpu")
    except FileNotFoundError:
        raise ValueError(f"{path} does not exist: name a folder that holds a run") from None
    except (OSError, EOFError, RuntimeError, pickle.UnpicklingError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path} is no readable checkpoint ({reason}): take another") from error
    if not isinstance(content, dict) or "format" not in content:
        raise ValueError(f"{path} is no checkpoint: take another")
    if (format := content.pop("format")) != FORMAT:
        raise ValueError(
            f"{path} is of another version of dntorch, format {format} instead of {FORMAT}: use "
            "that version, or begin a new run"
        )
    return _map(content, _unpack)


def _map(value: Any, leaf: Callable[[Any], Any]) -> Any:
    packed = leaf(value)
    if packed is not value:
        return packed
    if isinstance(value, dict):
        return {k: _map(v, leaf) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_map(v, leaf) for v in value)
    return value


def _pack(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"__array__": torch.from_numpy(value.copy())}
    if isinstance(value, (bytes, bytearray)):
        return {"__bytes__": torch.frombuffer(bytearray(value), dtype=torch.uint8)}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _unpack(value: Any) -> Any:
    if isinstance(value, dict) and set(value) == {"__array__"}:
        return value["__array__"].numpy()
    if isinstance(value, dict) and set(value) == {"__bytes__"}:
        return value["__bytes__"].numpy().tobytes()
    return value


# ------------------------------------------------------------------ JSON


def write_json(path: Path, content: dict[str, Any]) -> None:
    """All or nothing: a reader never sees half a file."""
    text = json.dumps(plain(content), indent=1) + "\n"
    write_atomically(path, lambda file: file.write(text.encode()))


def plain(value: Any) -> Any:
    """The same in what JSON knows: lists and numbers, null for nan and infinity."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value

"""Files that are whole or absent: checkpoints with a checksum, and results as JSON."""

import hashlib
import io
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np
import torch

from dntorch.lock import PART
from dntorch.packing import pack, unpack

FORMAT = 3


class Sink(io.RawIOBase):
    """Where writers write to: it hashes what comes, and keeps the first error for later.

    PyTorch and NumPy turn an error of the disk into one of their own, or into a traceback of a
    destructor. Here what comes after the first error is dropped, and who opened the file raises.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.file, self.sha256 = file, hashlib.sha256()
        self.error: OSError | None = None

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        if self.error is None:
            try:
                self.file.write(data)
                self.sha256.update(data)
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes

    def check(self) -> None:
        if self.error is not None:
            raise self.error


def write_atomically(
    path: Path, write: Callable[["Sink"], Any], before: Path | None = None
) -> None:
    """Write a file under another name, flush it to disk, then give it its own.

    Killed at any moment, ``path`` holds the old content or the new, never a part; the old goes
    to ``before``, if that is given.

    Raises:
        OSError: a full disk, say; ``path`` is as it was.
    """
    temporary = path.with_name(f".{path.name}.{uuid4().hex}{PART}")
    try:
        with temporary.open("xb") as file:
            sink = Sink(file)
            write(sink)
            sink.check()
            file.flush()
            os.fsync(file.fileno())
        if before is not None and path.exists():
            _keep(path, before)
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(
                f"{path} cannot be written ({error.strerror or error}): make room, or name another "
                "folder; what it held before is whole"
            ) from error
        raise


def _keep(path: Path, before: Path) -> None:
    before.unlink(missing_ok=True)
    try:
        os.link(path, before)
    except OSError:  # a file system without links
        shutil.copyfile(path, before)


# ------------------------------------------------------------------ checkpoints

HEADER = "dntorch checkpoint, format {}, sha256 {}\n"
BEGIN = re.compile(rb"dntorch checkpoint, format (\d+), sha256 ([0-9a-f]{64})\n")


def before(path: Path) -> Path:
    """Where the checkpoint lies that ``path`` held before its last save."""
    return path.with_name(f"{path.stem}.before{path.suffix}")


def save(path: Path | str, content: dict[str, Any]) -> None:
    """Save numbers, text, tensors, arrays and bytes in nested dicts, lists and tuples.

    The checkpoint that was there is kept `before` it, in case the new one gets damaged.

    Raises:
        ValueError: something in it could not be loaded again; the sentence says where.
        OSError: it cannot be written; the checkpoint that was there is whole.
    """
    path, packed = Path(path), pack(content)
    write_atomically(path, lambda sink: _write(sink, packed), before(path))


def load(path: Path | str) -> dict[str, Any]:
    """Load what `save` saved, without running any code that the file might bring.

    Raises:
        ValueError: there is no checkpoint, or it is damaged or of another version.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            return _read(file, path)
    except FileNotFoundError:
        raise ValueError(f"{path} does not exist: name a folder that holds a run") from None
    except OSError as error:
        raise _unreadable(path, error.strerror) from error


def to_bytes(content: dict[str, Any]) -> bytes:
    """A checkpoint that is sent somewhere, not written to a file."""
    file = io.BytesIO()
    _write(Sink(file), pack(content))
    return file.getvalue()


def from_bytes(data: bytes) -> dict[str, Any]:
    """The content of `to_bytes`; raises as `load` does."""
    return _read(io.BytesIO(data), None)


def _write(sink: Sink, packed: dict[str, Any]) -> None:
    sink.file.write(HEADER.format(FORMAT, "0" * 64).encode())
    sink.sha256.update(str(FORMAT).encode())
    torch.save(packed, sink)
    sink.file.seek(0)
    sink.file.write(HEADER.format(FORMAT, sink.sha256.hexdigest()).encode())


def _read(file: BinaryIO, path: Path | None) -> dict[str, Any]:
    begin = BEGIN.fullmatch(file.readline(200))
    if begin is None:
        raise _unreadable(path, "it is damaged, or of an earlier version")
    start, sha256 = file.tell(), hashlib.sha256(begin[1])
    while block := file.read(1 << 20):
        sha256.update(block)
    if sha256.hexdigest().encode() != begin[2]:
        raise _unreadable(path, "it is damaged: its content is not what was saved")
    if (format := int(begin[1])) != FORMAT:
        raise ValueError(
            f"{path or 'the state'} is of another version of dntorch, format {format} "
            f"instead of {FORMAT}: use that version, or begin a new run"
        )
    file.seek(start)
    try:
        return unpack(torch.load(file, weights_only=True, map_location="cpu"))
    except Exception as error:  # written by something else: PyTorch has many words for that
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise _unreadable(path, reason) from error


def _unreadable(path: Path | None, reason: str | None) -> ValueError:
    """The error of a file that is no checkpoint; it names the one before it, if that is whole."""
    text = f"{path or 'the state'} is no readable checkpoint ({reason}): name another checkpoint"
    if path is not None and (former := before(path)).exists():
        try:
            load(former)
        except ValueError:
            return ValueError(text)
        text += f", such as the one before it: rename {former} to {path.name}"
    return ValueError(text)


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

"""An agent's state as bytes."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor

from dntorch import files


def pack(content: dict[str, Any]) -> dict[str, Tensor]:
    """A checkpoint as bytes: collectors send nothing between processes but dicts of tensors."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        files.save(path, content)
        return {"bytes": torch.frombuffer(bytearray(path.read_bytes()), dtype=torch.uint8)}


def unpack(packed: dict[str, Tensor]) -> dict[str, Any]:
    """The content of `pack`, without running any code that it might bring."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        path.write_bytes(packed["bytes"].numpy().tobytes())
        return files.load(path)

"""An agent's state as bytes."""

from typing import Any

import torch
from torch import Tensor

from dntorch import files


def to_tensors(content: dict[str, Any]) -> dict[str, Tensor]:
    """A checkpoint as bytes: collectors send nothing between processes but dicts of tensors.

    Raises:
        ValueError: something in it could not be loaded again; the sentence says where.
    """
    return {"bytes": torch.frombuffer(bytearray(files.to_bytes(content)), dtype=torch.uint8)}


def from_tensors(tensors: dict[str, Tensor]) -> dict[str, Any]:
    """The content of `to_tensors`, without running any code that it might bring."""
    return files.from_bytes(tensors["bytes"].numpy().tobytes())

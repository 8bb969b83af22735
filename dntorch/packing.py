"""What a checkpoint may hold, in the types that load without running code."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

ARRAY, BYTES = "__array__", "__bytes__"
PLAIN = (type(None), bool, int, float, complex, str)
KEYS = (type(None), bool, int, float, str, bytes)
TENSORS = (Tensor, torch.nn.Parameter, torch.Size, torch.dtype, torch.device)
ALLOWED = (
    "give numbers, text, bytes, tensors, arrays of numbers, and dicts, lists and tuples of them"
)
BITS = 2000
"""A longer whole number is written in a way that no restricted reader knows."""


def pack(content: dict[str, Any]) -> dict[str, Any]:
    """The same in types that `unpack` brings back; every dict becomes a plain one.

    Raises:
        ValueError: something else is in it; the sentence says where.
    """
    try:
        return {key: _pack(value, str(key)) for key, value in content.items()}
    except RecursionError:
        raise ValueError(
            "the content of a checkpoint is nested too deeply, or holds itself: give a flat dict"
        ) from None


def unpack(value: Any) -> Any:
    """The content that was packed."""
    if isinstance(value, dict):
        if set(value) == {ARRAY}:
            return value[ARRAY].numpy()
        if set(value) == {BYTES}:
            return value[BYTES].numpy().tobytes()
        return {key: unpack(one) for key, one in value.items()}
    if type(value) in (list, tuple):
        return type(value)(map(unpack, value))
    return value


def _pack(value: Any, path: str) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if type(value) is np.ndarray:
        return {ARRAY: _numbers(value, path)}
    if type(value) in (bytes, bytearray):
        return {BYTES: torch.from_numpy(np.frombuffer(value, np.uint8).copy())}
    if isinstance(value, dict):
        _check_keys(value, path)
        return {key: _pack(one, _below(path, key)) for key, one in value.items()}
    if type(value) in (list, tuple):
        return type(value)([_pack(one, f"{path}[{k}]") for k, one in enumerate(value)])
    if type(value) in PLAIN and not _is_readable(value):
        raise ValueError(f"{path} has {BITS} bits or more, or is no Unicode: give it as bytes")
    if type(value) in TENSORS + PLAIN:
        return value
    raise ValueError(f"{path} is a {type(value).__name__}: {ALLOWED}")


def _numbers(array: np.ndarray, path: str) -> Tensor:
    try:
        return torch.from_numpy(array.copy())
    except (TypeError, ValueError):
        raise ValueError(f"{path} is an array of dtype {array.dtype}: {ALLOWED}") from None


def _check_keys(value: dict, path: str) -> None:
    for key in value:
        parts = key if type(key) is tuple else (key,)
        if not all(type(part) in KEYS and _is_readable(part) for part in parts):
            raise ValueError(f"{path} has the key {key!r}: give text or numbers as keys")
        if len(value) == 1 and key in (ARRAY, BYTES):
            raise ValueError(f"{path} has the one key {key!r}, which has a meaning: rename it")


def _is_readable(value: Any) -> bool:
    if type(value) is int:
        return value.bit_length() < BITS
    return type(value) is not str or _is_text(value)


def _is_text(value: str) -> bool:
    try:
        value.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False
    return True


def _below(path: str, key: Any) -> str:
    return f"{path}.{key}" if isinstance(key, str) else f"{path}[{key!r}]"

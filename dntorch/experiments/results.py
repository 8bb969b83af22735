"""Results as JSON: numbers, and the commit that computed them."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from dntorch.experiments.checkpoint import write_atomically


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


def commit() -> str | None:
    """The commit that the code is at, if it is in a git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None

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
    """The commit of the source tree, with a mark if files differ from it; None if installed."""
    here = Path(__file__)
    git = ["git", "-C", str(here.parent)]
    options: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 20, "check": True}
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", here.name], **options)
        describe = [*git, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        return subprocess.run(describe, **options).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None

"""Check exported artefacts in a fresh process, where this package can't be imported."""

import subprocess
import sys
from pathlib import Path

from dntorch.export import replay


def verify(folder: Path) -> bool:
    """Print how far each artefact is from the golden record; whether all pass."""
    # By path: a program, not a part of this package.
    return subprocess.run([sys.executable, replay.__file__, str(folder)]).returncode == 0

"""Check exported artefacts in a fresh process, where this package can't be imported."""

import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from dntorch.export import reading, replay, runtimes, trust

OWN = re.compile(r"^from dntorch\.export\.\w+ import (?:\([^)]*\)|.*)\n", re.MULTILINE)


def checking_program() -> str:
    """The program as one file, which needs no other of this package."""
    parts = [Path(part.__file__).read_text() for part in (reading, trust, runtimes, replay)]
    return f'"""{replay.__doc__}"""\n\n' + "\n\n".join(OWN.sub("", part) for part in parts)


def verify(folder: Path, trust: bool = False) -> bool:
    """Print how far each artefact is from the golden record; whether all pass.

    Args:
        folder: of an export.
        trust: load native code, too. It can do whatever you can.

    Raises:
        ValueError: no export there.
    """
    if not (folder / reading.MANIFEST).exists():
        raise ValueError(reading.ABSENT.format(folder / reading.MANIFEST))
    with TemporaryDirectory() as own:  # not the program in the folder, which is as it was sent
        path = Path(own, "verify.py")
        path.write_text(checking_program())
        code = subprocess.run([sys.executable, path, *["--trust"] * trust, folder]).returncode
    if code < 0:
        print(f"verify: a program in {folder} ended its process with signal {-code}: do not use it")
    return code == 0

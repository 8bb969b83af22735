"""Who works in a folder: one process at a time, whose name others can read.

Imports no PyTorch: commands that answer at once import this file.
"""

import contextlib
import errno
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

try:
    import fcntl
except ImportError:  # Windows: without locks
    fcntl = None

LOCK, PART = ".lock", ".part"
"""Names that begin with a dot: of the lock; the end of those of files that are being written."""
LOOK = 0.1
"""s, from one look at a lock to the next."""
WITHOUT = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""What file systems say that know no locks."""


@contextlib.contextmanager
def owned(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Inside the block nobody else who asks works in ``folder``; leftovers there are removed.

    The operating system holds the lock: it ends with the process, however that ends.

    Args:
        patience: how long to wait for another process to end, in seconds.

    Raises:
        ValueError: another process works there, or there is no such folder.
        OSError: it cannot be written to.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder} does not exist: name a folder that holds a run")
    if fcntl is None:
        clear_leftovers(folder)
        yield
        return
    path = folder / LOCK
    with _locked(path, time.monotonic() + patience) as file:
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        clear_leftovers(folder)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)  # while it is held: see `_is_at`


def clear_leftovers(folder: Path) -> None:
    """Remove what writers that were killed left behind, in a folder that nobody writes to."""
    for leftover in folder.glob(f".*{PART}*"):
        leftover.unlink(missing_ok=True)


def _locked(path: Path, until: float) -> TextIO:
    """The file, locked; by another process it was so until this moment."""
    while True:
        try:
            file = path.open("a+")
        except OSError as error:
            raise OSError(
                f"{path.parent} cannot be written to ({error.strerror}): name another folder"
            ) from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_at(file, path):
                return file
            file.close()  # its owner has removed it in the meantime: take the new one
            continue
        except BlockingIOError:
            file.seek(0)
            owner = file.read() or "another process"
        except OSError as error:
            if error.errno in WITHOUT:
                return file
            raise
        file.close()
        if time.monotonic() >= until:
            raise ValueError(
                f"{path.parent} is in use by {owner}: wait until that ends, or name another folder"
            )
        time.sleep(LOOK)


def _is_at(file: TextIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False

"""What the value of an option may be: refused in one sentence before a command begins.

Every option that is neither a switch nor a choice is of one of these kinds.
"""

import stat
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click

from dntorch.quantities import Interval


class Kind(click.ParamType):
    """Turns a text into a value, or says what to give."""

    def convert(self, value: Any, param: click.Parameter | None, _: click.Context | None) -> Any:
        try:
            return self.read(value)
        except ValueError as error:
            raise ValueError(f"{named(param, value)}: {error}") from error

    def read(self, value: Any) -> Any:
        """The value.

        Raises:
            ValueError: it is none; the message is the remedy.
        """
        raise NotImplementedError


class Number(Kind):
    """A finite number within limits."""

    def __init__(self, within: Interval) -> None:
        self.within, self.name = within, "integer" if within.whole else "float"

    def read(self, value: Any) -> Any:
        try:
            number = (int if self.within.whole else float)(value)
        except ValueError:
            number = None
        if number not in self.within:
            raise ValueError(f"give {self.within}")
        return number


def whole(least: int, most: int) -> Number:
    """A whole number."""
    return Number(Interval(least, most, whole=True))


class Parsed(Kind):
    """A text with a grammar of its own.

    Args:
        parse: makes the value of it, or raises a ``ValueError`` whose message is the remedy.
        name: of what it is.
    """

    name = "text"

    def __init__(self, parse: Callable[[str], Any], name: str = "text") -> None:
        self.read, self.name = parse, name  # type: ignore[method-assign]


class Place(click.Path):
    """A file or folder; a shell completes it.

    Args:
        check: raises an ``OSError``, or a ``ValueError`` with the remedy, unless it will do.
        cannot: what an ``OSError`` means.
        folder: whether it is one.
    """

    def __init__(self, check: Callable[[Path], Any], cannot: str, folder: bool = False) -> None:
        super().__init__(file_okay=not folder, dir_okay=folder, path_type=Path)
        self.check, self.cannot = check, cannot

    def convert(self, value: Any, param: click.Parameter | None, _: click.Context | None) -> Path:
        label = named(param, value)
        try:
            if not str(value) or "\0" in str(value):
                raise ValueError("give a path")
            self.check(Path(value))
        except OSError as error:
            reason = error.strerror or error
            raise ValueError(f"{label} {self.cannot} ({reason}): name another") from error
        except ValueError as error:
            raise ValueError(f"{label}: {error}") from error
        return Path(value)


def named(param: click.Parameter | None, value: Any) -> str:
    """An option and its value, as they are typed."""
    text = str(value)
    name = param.opts[0] if isinstance(param, click.Option) else param and param.human_readable_name
    return f"{name}={text if len(text) <= 200 else text[:200] + '...'}"


def once(given: Iterable[tuple[str, Any]], option: str, remedy: str) -> None:
    """Raise if a name was given twice: the first value would be dropped in silence."""
    names: set[str] = set()
    for name, _ in given:
        if name in names:
            raise ValueError(f"{option} {name} is given twice: {remedy}")
        names.add(name)


def _host(name: str) -> str:
    from dntorch.robot.transports import is_host

    if not is_host(name):
        raise ValueError("give a name or an address of this machine, such as 0.0.0.0 for all")
    return name


HOST = Parsed(_host)
"""A name or an address to listen on."""


# ------------------------------------------------------------------ places


def _to_make(folder: Path) -> None:
    """Raise unless a folder is there, or can be made, and files in it."""
    there = next(each for each in (folder, *folder.parents) if _exists(each))
    if not there.is_dir():
        raise ValueError(f"{there} is no folder: name another")
    with tempfile.TemporaryFile(dir=there):  # no question of rights alone: a disk, /proc
        pass


def _to_write(file: Path) -> None:
    """Raise unless a file can be written."""
    if not _exists(file):
        if not file.parent.is_dir():
            raise ValueError(f"the folder {file.parent} does not exist: make it or name another")
        _to_make(file.parent)
    elif stat.S_ISREG(file.stat().st_mode):
        file.open("ab").close()
    else:
        raise ValueError("it is there and no file: name another")


def _to_enter(folder: Path) -> None:
    if not folder.is_dir():
        raise ValueError("there is no such folder: name a folder that holds a run, or an export")
    next(folder.iterdir(), None)


def _to_read(file: Path) -> None:
    if not stat.S_ISFIFO(file.stat().st_mode):  # such as <(command): readable only once
        file.open("rb").close()


def _exists(path: Path) -> bool:
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


WRITTEN, READ = "cannot be written to", "cannot be read"
NEW_FOLDER = Place(_to_make, WRITTEN, folder=True)
OLD_FOLDER = Place(_to_enter, READ, folder=True)
NEW_FILE, OLD_FILE = Place(_to_write, WRITTEN), Place(_to_read, READ)

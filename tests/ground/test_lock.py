"""A folder belongs to one process at a time, and to nobody once that has ended."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dntorch import lock
from dntorch.lock import LOCK, owned

HOLDS = """
import sys
from pathlib import Path
from dntorch.lock import owned
with owned(Path(sys.argv[1])):
    print("mine", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def owner(tmp_path: Path):
    """Another process that works in the folder."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, tmp_path],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "mine\n"
        yield process
        process.kill()


def test_a_folder_in_use_names_its_owner(owner, tmp_path: Path) -> None:
    for _ in range(2):  # asking changes nothing
        with pytest.raises(ValueError) as raised, owned(tmp_path):
            pass
        assert str(raised.value) == (
            f"{tmp_path} is in use by process {owner.pid} on {socket.gethostname()}: wait until "
            "that ends, or name another folder"
        )


def test_a_killed_owner_leaves_it_to_the_next(owner, tmp_path: Path) -> None:
    owner.kill()
    owner.wait(timeout=60)
    assert (tmp_path / LOCK).exists()
    with owned(tmp_path):
        assert f"process {os.getpid()} on" in (tmp_path / LOCK).read_text()
    assert not (tmp_path / LOCK).exists()


def test_who_has_patience_gets_it_when_its_owner_ends(owner, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="in use"), owned(tmp_path, patience=0.3):
        pass
    owner.stdin.close()
    with owned(tmp_path, patience=60):
        pass


def test_leftovers_are_removed_once_it_is_owned(owner, tmp_path: Path) -> None:
    part, film = tmp_path / ".checkpoint.pt.x.part", tmp_path / ".video.part.webm"
    part.touch(), film.touch()
    with pytest.raises(ValueError, match="in use"), owned(tmp_path):
        pass
    assert part.exists()  # the owner may be writing it
    owner.kill()
    with owned(tmp_path, patience=60):
        assert not part.exists() and not film.exists()


def test_an_error_gives_it_back(tmp_path: Path) -> None:
    with pytest.raises(KeyError), owned(tmp_path):
        raise KeyError
    with owned(tmp_path):
        pass


def test_a_lock_that_its_owner_has_just_removed_is_none(tmp_path: Path) -> None:
    with owned(tmp_path):
        (tmp_path / LOCK).unlink()
        with owned(tmp_path):
            pass


def test_no_folder_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="does not exist: name a folder"), owned(tmp_path / "no"):
        pass


def test_a_file_system_without_locks_does_without(tmp_path: Path, monkeypatch) -> None:
    def flock(*_):
        raise OSError(lock.WITHOUT[0], "No locks available")

    monkeypatch.setattr(lock.fcntl, "flock", flock)
    with owned(tmp_path):
        pass
    monkeypatch.setattr(lock, "fcntl", None)
    (tmp_path / ".x.part").touch()
    with owned(tmp_path):
        assert not (tmp_path / ".x.part").exists()


MANY = """
import sys
from pathlib import Path
from dntorch.lock import owned
folder, here = Path(sys.argv[1]), Path(sys.argv[1], "here")
for _ in range(50):
    with owned(folder, patience=100):
        here.mkdir()  # raises if somebody else is here
        here.rmdir()
"""


def test_of_many_only_one_is_there_at_a_time(tmp_path: Path, monkeypatch) -> None:
    code = MANY.replace("import sys\n", "import sys\nfrom dntorch import lock\nlock.LOOK = 0.001\n")
    many = [subprocess.Popen([sys.executable, "-c", code, tmp_path]) for _ in range(3)]
    until = time.monotonic() + 120
    assert [process.wait(timeout=until - time.monotonic()) for process in many] == [0, 0, 0]

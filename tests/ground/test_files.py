"""Files are whole or absent, and a checkpoint that is not what was saved is not loaded."""

import collections
import enum
import json
import random
import resource
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from dntorch import files
from dntorch.rl.state import from_tensors, to_tensors

CONTENT = {"weights": torch.arange(300.0), "config": {"noise": 10.0}, "steps": np.arange(50)}


def refusal(path: Path) -> str:
    with pytest.raises(ValueError) as raised:
        files.load(path)
    text = str(raised.value)
    assert text.startswith(str(path)) and "\n" not in text
    return text


# ---------------------------------------------------------------- damage


def test_one_bit_flipped_anywhere_is_refused_and_the_one_before_is_named(tmp_path: Path) -> None:
    path, chance = tmp_path / "checkpoint.pt", random.Random(0)
    files.save(path, CONTENT | {"step": 1})
    files.save(path, CONTENT | {"step": 2})
    whole = path.read_bytes()
    for place in (*range(110), *chance.sample(range(110, len(whole)), 300)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        text = refusal(path)
        assert f"rename {files.before(path)} to checkpoint.pt" in text
    files.before(path).rename(path)
    assert files.load(path)["step"] == 1


@pytest.mark.parametrize("size", [0, 1, 50, 100, 101, -1])
def test_a_part_of_a_checkpoint_is_refused(size: int, tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    files.save(path, CONTENT)
    path.write_bytes(path.read_bytes()[:size])
    assert "name another" in refusal(path)


def test_a_damaged_one_before_is_not_named(tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    for _ in range(2):
        files.save(path, CONTENT)
    for file in (path, files.before(path)):
        file.write_bytes(file.read_bytes()[:-1])
    assert "rename" not in refusal(path)


def test_the_checkpoint_before_is_always_that_of_the_last_save_but_one(tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    for step in range(4):
        files.save(path, {"step": step})
        assert files.load(path)["step"] == step
        assert not step or files.load(files.before(path))["step"] == step - 1


def test_a_file_system_without_links_keeps_it_too(tmp_path: Path, monkeypatch) -> None:
    def link(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(files.os, "link", link)
    test_the_checkpoint_before_is_always_that_of_the_last_save_but_one(tmp_path)


@pytest.mark.parametrize("content", [{"format": 2, "step": 1}, {"weights": torch.zeros(3)}, [1]])
def test_what_an_earlier_version_saved_is_refused(content, tmp_path: Path) -> None:
    torch.save(content, tmp_path / "c.pt")
    assert "of an earlier version" in refusal(tmp_path / "c.pt")


def test_another_format_is_named(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(files, "FORMAT", 99)
    files.save(tmp_path / "c.pt", CONTENT)
    monkeypatch.undo()
    assert "format 99 instead of 3" in refusal(tmp_path / "c.pt")


def test_a_checksum_that_was_adapted_runs_no_code_either(tmp_path: Path, monkeypatch) -> None:
    class Bomb:
        def __reduce__(self):
            return exec, (f"open({str(tmp_path / 'ran')!r}, 'w')",)

    monkeypatch.setattr(files, "pack", lambda content: content)
    files.save(tmp_path / "c.pt", {"bomb": Bomb()})
    assert "no readable checkpoint" in refusal(tmp_path / "c.pt")
    assert not (tmp_path / "ran").exists()


def test_a_folder_is_no_checkpoint(tmp_path: Path) -> None:
    assert "name another" in refusal(tmp_path)


# ---------------------------------------------------------------- no room


@contextmanager
def room(size: int):
    """No file may become larger: the error of a full disk, without one."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)


LARGE = np.random.default_rng(0).random(40_000)
WRITERS = {
    "checkpoint": lambda path, n: files.save(path, {"n": n, "a": LARGE[:n]}),
    "json": lambda path, n: files.write_json(path, {"a": LARGE[:n]}),
    "arrays": lambda path, n: files.write_atomically(path, partial(np.savez, a=LARGE[:n])),
    "packed": lambda path, n: files.write_atomically(
        path, partial(np.savez_compressed, a=LARGE[:n])
    ),
}


@pytest.mark.filterwarnings("error")  # what a destructor says is a traceback, too
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_one_sentence_and_the_old_file_is_whole(name: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    WRITERS[name](path, 100)
    whole = path.read_bytes()
    for size in (0, 4096, 100_000):
        with room(size), pytest.raises(OSError) as raised:
            WRITERS[name](path, 40_000)
        text = str(raised.value)
        assert text.startswith(f"{path} cannot be written (File too large): make room")
        assert path.read_bytes() == whole
        assert [one.name for one in tmp_path.iterdir()] == ["file"]


def test_a_folder_that_is_gone_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"cannot be written \(No such file or directory\): make"):
        files.write_json(tmp_path / "gone" / "x.json", {})


# ---------------------------------------------------------------- what saves, loads


class Color(enum.IntEnum):
    RED = 1


class Point(collections.namedtuple("Point", "x y")):
    pass


HOLDS_ITSELF: list = []
HOLDS_ITSELF.append(HOLDS_ITSELF)

REFUSED = {
    "deque": (collections.deque([1]), "world.extra is a deque: give numbers"),
    "set": ({1}, "world.extra is a set: "),
    "tuple with a name": (Point(1, 2), "world.extra is a Point: "),
    "range": (range(3), "world.extra is a range: "),
    "enumeration": (Color.RED, "world.extra is a Color: "),
    "path": (Path("x"), "world.extra is a "),
    "function": (len, "world.extra is a builtin_function_or_method: "),
    "generator": (np.random.default_rng(0), "world.extra is a Generator: "),
    "deeper": ({"a": [0, (1, collections.deque())]}, "world.extra.a[1][1] is a deque: "),
    "objects": (np.array([None]), "world.extra is an array of dtype object: "),
    "text": (np.array(["a"]), "world.extra is an array of dtype <U1: "),
    "time": (np.datetime64("2020-01-01"), "world.extra is a date: "),
    "masked": (np.ma.array([1], mask=[True]), "world.extra is a MaskedArray: "),
    "long": (1 << 3000, "world.extra has 2000 bits or more"),
    "half": ("\ud800", "world.extra has 2000 bits or more, or is no Unicode"),
    "key": ({frozenset(): 1}, "world.extra has the key frozenset()"),
    "number of NumPy as key": ({np.int64(1): 1}, "world.extra has the key "),
    "key with a meaning": ({"__array__": 1}, "the one key '__array__', which has a meaning"),
    "itself": (HOLDS_ITSELF, "nested too deeply, or holds itself"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_could_not_be_loaded_is_refused_at_the_save(name: str, tmp_path: Path) -> None:
    value, words = REFUSED[name]
    files.save(tmp_path / "c.pt", {"step": 1})
    for save in (to_tensors, partial(files.save, tmp_path / "c.pt")):
        with pytest.raises(ValueError) as raised:
            save({"world": {"extra": value}})
        assert words in str(raised.value)
    assert files.load(tmp_path / "c.pt") == {"step": 1} and len([*tmp_path.iterdir()]) == 1


SAVED = [
    None, True, 3, -(1 << 100), 1.5, float("inf"), 2j, "", "Größe", b"", b"abc", [], {}, (),
    (1, [2.0, {"a": (None,)}]), {1: 2, None: 3, 1.5: 4, b"x": 5, (1, "a"): 6},
    torch.Size([2]), torch.float32, torch.zeros(0), torch.tensor(True), torch.tensor([1j]),
    torch.arange(6).view(2, 3).t(), np.zeros(0), np.array(3), np.arange(6, dtype=np.uint16)[::-1],
    np.array([True]), np.random.PCG64(3).state,
]  # fmt: skip


@pytest.mark.parametrize("value", SAVED, ids=repr)
def test_what_saves_loads(value, tmp_path: Path) -> None:
    files.save(tmp_path / "c.pt", {"value": value})
    for loaded in (files.load(tmp_path / "c.pt"), from_tensors(to_tensors({"value": value}))):
        if isinstance(value, torch.Tensor):
            assert torch.equal(loaded["value"], value)
        elif isinstance(value, np.ndarray):
            assert loaded["value"].dtype == value.dtype
            np.testing.assert_array_equal(loaded["value"], value)
        else:
            assert loaded["value"] == value and type(loaded["value"]) is type(value)


def test_other_dicts_and_numbers_of_numpy_become_plain(tmp_path: Path) -> None:
    many = collections.defaultdict(list, a=[np.float32(0.5), np.int8(3), bytearray(b"x")])
    files.save(tmp_path / "c.pt", {"many": many})
    assert files.load(tmp_path / "c.pt") == {"many": {"a": [0.5, 3, b"x"]}}


def test_json_knows_no_nan(tmp_path: Path) -> None:
    files.write_json(tmp_path / "x.json", {"a": [np.nan, np.float32(0.5), (1,)]})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": [None, 0.5, [1]]}

"""Exports of strangers: nothing runs that is not a computation on tensors, nothing bad passes."""

import hashlib
import io
import json
import pickle
import resource
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

import dntorch
from dntorch.export import RUNTIMES, export_structure, reading, replay, trust, verify

SAMPLE, CONSTANTS = "data/sample_inputs/model.pt", "data/constants/model_constants_config.json"


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    rows = [(torch.rand(3),) for _ in range(20)]
    return export_structure(dntorch.NodeWTA(3), folder, rows)


@pytest.fixture
def copy(exported, tmp_path) -> Path:
    return Path(shutil.copytree(exported, tmp_path / "copy"))


def change(folder: Path, edit) -> None:
    """Edit the manifest."""
    manifest = json.loads((folder / "manifest.json").read_text())
    edit(manifest)
    (folder / "manifest.json").write_text(json.dumps(manifest))


def sign(folder: Path, *runtimes: str) -> None:
    """Adapt the checksums, as whoever sends an export can; keep the artefacts of some runtimes."""

    def adapt(manifest: dict) -> None:
        files = manifest["files"]
        kept = [n for n, e in files.items() if not runtimes or e.get("runtime") in runtimes]
        manifest["files"] = {name: files[name] for name in kept}
        for name in kept:
            content = (folder / name).read_bytes()
            files[name] |= {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}

    change(folder, adapt)


def rewrite(path: Path, edit) -> None:
    """Edit the members of an archive, as a dict by name."""
    with zipfile.ZipFile(path) as archive:
        members = {name.partition("/")[2]: archive.read(name) for name in archive.namelist()}
    edit(members)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(f"archive/{name}", content)


class Bomb:
    """Runs when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return exec, (expression(self.mark),)


def expression(mark: Path) -> str:
    return f"__import__('pathlib').Path({str(mark)!r}).touch()"


def bomb(mark: Path) -> bytes:
    buffer = io.BytesIO()
    torch.save(Bomb(mark), buffer)
    return buffer.getvalue()


def edited(members: dict, name: str, edit) -> None:
    content = json.loads(members[name])
    edit(content)
    members[name] = json.dumps(content).encode()


def sample(members, mark):
    members[SAMPLE] = bomb(mark)


def constant(members, mark):
    def edit(content):
        first = next(iter(content["config"].values()))
        first.update(use_pickle=True, path_name="tensor_0")

    edited(members, CONSTANTS, edit)
    members["data/constants/tensor_0"] = bomb(mark)


def opaque(members, mark):
    def edit(content):
        first = next(iter(content["config"].values()))
        first.update(use_pickle=True, path_name="opaque_obj_0")

    edited(members, CONSTANTS, edit)
    members["data/constants/opaque_obj_0"] = pickle.dumps(Bomb(mark))


def weights(members, mark):
    members["data/weights/model.pt"] = bomb(mark)


def old_constants(members, mark):
    members["data/constants/model.pt"] = bomb(mark)


def second_model(members, mark):
    members["models/other.json"] = members["models/model.json"]
    members["data/sample_inputs/other.pt"] = bomb(mark)


def compiled(members, mark):
    members["data/aotinductor/model/model.so"] = b"\x7fELF"


def expr(members, mark):
    def edit(content):
        values = content["graph_module"]["graph"]["tensor_values"]
        sized = next(value for value in values.values() if value["sizes"])
        sized["sizes"] = [{"as_expr": {"expr_str": expression(mark), "hint": {"as_int": 3}}}]

    edited(members, "models/model.json", edit)


def guard(members, mark):
    edited(
        members,
        "models/model.json",
        lambda content: content["guards_code"].append(expression(mark)),
    )


def default(members, mark):
    name = f"u={expression(mark)}"
    text = members["models/model.json"].decode().replace('"name": "u"', f'"name": "{name}"')
    members["models/model.json"] = text.replace('["input", "u"]', f'["input", "{name}"]').encode()


def target(members, mark):
    text = members["models/model.json"].decode()
    members["models/model.json"] = text.replace("torch.ops.aten.abs.default", "torch.load").encode()


def mapped(members, mark):
    text = members["models/model.json"].decode()
    wrong = text.replace("torch.ops.aten.abs.default", "torch.ops.aten.from_file.default")
    members["models/model.json"] = wrong.encode()


HOSTILE = [sample, constant, opaque, weights, old_constants, second_model, compiled, expr, guard,
           default, target, mapped]  # fmt: skip


@pytest.mark.parametrize("edit", HOSTILE, ids=lambda edit: edit.__name__)
@pytest.mark.parametrize("trust", [False, True])
def test_a_program_that_would_run_code_is_not_loaded(edit, trust, copy, tmp_path, capsys) -> None:
    mark = tmp_path / "ran"
    rewrite(copy / "structure.pt2", lambda members: edit(members, mark))
    sign(copy, "export")
    assert not replay.verify(copy, trust)
    assert not mark.exists()
    (line,) = [one for one in capsys.readouterr().out.splitlines() if "FAILED" in one]
    assert line.startswith("structure.pt2: FAILED: ") and line.endswith(": not loaded")


@pytest.mark.parametrize("edit", [sample, constant, expr, guard], ids=lambda edit: edit.__name__)
def test_the_attacks_are_real(edit, copy, tmp_path, monkeypatch) -> None:
    """Else the tests above would test nothing."""
    mark = tmp_path / "ran"
    rewrite(copy / "structure.pt2", lambda members: edit(members, mark))
    sign(copy, "export")
    monkeypatch.setattr(replay, "check_safe", lambda *_: None)
    replay.verify(copy)
    assert mark.exists()


def test_an_archive_with_two_members_of_a_name_is_not_loaded(copy, tmp_path, capsys) -> None:
    with zipfile.ZipFile(copy / "structure.pt2", "a") as archive:
        top = archive.namelist()[0].partition("/")[0]
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr(f"{top}/{SAMPLE}", bomb(tmp_path / "ran"))
    sign(copy, "export")
    assert not replay.verify(copy)
    assert "not loaded" in capsys.readouterr().out and not (tmp_path / "ran").exists()


class Writing(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        torch.save(x, "SOMEWHERE")
        return x


class Mapping(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.from_file("SOMEWHERE", True, 1)


@pytest.mark.parametrize("module", [Writing(), Mapping()], ids=["save", "from_file"])
def test_torchscript_that_touches_files_is_not_loaded(module, copy, capsys) -> None:
    torch.jit.script(module).save(copy / "structure.ts")
    sign(copy, "torchscript")
    assert not replay.verify(copy)
    assert "reaches beyond tensors: not loaded" in capsys.readouterr().out


def test_torchscript_with_a_pickle_of_python_is_not_loaded(copy, tmp_path, capsys) -> None:
    def edit(members):
        members["data.pkl"] = pickle.dumps(Bomb(tmp_path / "ran"), protocol=2)

    rewrite(copy / "structure.ts", edit)
    sign(copy, "torchscript")
    assert not replay.verify(copy)
    assert "pickle that names" in capsys.readouterr().out and not (tmp_path / "ran").exists()


def test_every_format_has_a_loader_and_a_rule_of_trust() -> None:
    ruled = [*trust.NATIVE, *trust.DATA, *trust.CHECKS]
    assert sorted(ruled) == sorted(RUNTIMES) == sorted(replay.LOADERS)


def test_native_code_is_loaded_only_if_trusted(copy, capsys, monkeypatch) -> None:
    loaded = []
    monkeypatch.setitem(replay.LOADERS, "aotinductor", lambda path, _: loaded.append(path))
    (copy / "structure.aoti.pt2").write_bytes(b"native")
    entry = {"runtime": "aotinductor"}
    change(copy, lambda m: m["files"].update({"structure.aoti.pt2": entry}))
    sign(copy, "aotinductor")
    assert not replay.verify(copy)
    assert "is native code: give --trust" in capsys.readouterr().out and not loaded
    assert not replay.verify(copy, trust=True)  # there is nothing in it
    assert loaded == [copy / "structure.aoti.pt2"]


def test_what_the_exporter_writes_is_loaded(exported, capsys) -> None:
    assert replay.verify(exported), capsys.readouterr().out
    for name, check in (
        ("structure.pt2", trust.check_program),
        ("structure.ts", trust.check_script),
    ):
        check(exported / name)


# ---------------------------------------------------------------- manifests that make all pass


def port(manifest: dict) -> dict:
    return manifest["state"][0]


WRONG = {
    "no artefacts": (lambda m: m.update(files={}), "lists no artefact"),
    "only the record": (lambda m: m.update(files={"golden.npz": {}}), "lists no artefact"),
    "tolerance": (lambda m: m["tolerance"].update(step=1e9), "tolerance of 1000000000.0 for step"),
    "nan": (lambda m: m["tolerance"].update(free=float("nan")), "tolerance of nan for free"),
    "text": (lambda m: m["tolerance"].update(free="1"), "tolerance of '1' for free"),
    "no tolerance": (lambda m: m.update(tolerance={}), "lacks a tolerance"),
    "threshold": (lambda m: m.update(thresholds={"u": float("inf")}), "threshold inf of u"),
    "unknown": (lambda m: m.update(thresholds={"v": 0.0}), "threshold 0.0 of v"),
    "no inputs": (lambda m: m.update(inputs=[]), "names no inputs"),
    "no outputs": (lambda m: m.update(outputs=[]), "names no outputs"),
    "huge": (lambda m: port(m).update(shape=[10**9]), "not float32"),
    "shape": (lambda m: port(m).update(shape=[-1]), "of shape"),
    "dtype": (lambda m: port(m).update(dtype="object"), "of dtype 'object'"),
    "lasting": (lambda m: port(m).update(lasting="no"), "says 'no'"),
    "dt": (lambda m: m.update(dt=float("nan")), "dt=nan"),
    "no rest": (lambda m: port(m).pop("rest"), "no rest value of u"),
    "wrong rest": (lambda m: port(m).update(rest=[1.0, 2.0]), "no rest value of u"),
    "twice": (lambda m: m["state"].append(port(m)), "two ports alike"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_manifest_that_lets_all_pass_is_refused_in_one_sentence(name, copy) -> None:
    edit, words = WRONG[name]
    change(copy, edit)
    with pytest.raises(reading.Unfit) as raised:
        replay.verify(copy)
    assert words in str(raised.value) and str(raised.value).endswith("export again")
    assert "\n" not in str(raised.value)


VALUES = [None, 3, -1.5, "text", [], {}, [3], {"a": 1}, True]


@pytest.mark.parametrize("key", [*reading.KINDS])
def test_a_wrong_type_is_no_traceback(key, copy, capsys) -> None:
    whole = (copy / "manifest.json").read_text()
    for value in VALUES:
        for edit in (
            lambda m, v=value: m.update({key: v}),
            lambda m, v=value: m[key].__setitem__(0 if isinstance(m[key], list) else "step", v),
            lambda m, v=value: [
                one.update(dict.fromkeys(one, v))
                for one in (m[key] if isinstance(m[key], list) else m[key].values())
            ],
        ):
            (copy / "manifest.json").write_text(whole)
            try:
                change(copy, edit)
            except (TypeError, AttributeError, IndexError, KeyError):
                continue  # not a container of such
            if (copy / "manifest.json").read_text() == json.dumps(json.loads(whole)):
                continue
            try:
                well = replay.verify(copy)
            except reading.Unfit as error:
                assert "\n" not in str(error)
                continue
            # What is only printed, or changes nothing that is compared.
            assert not well or key in ("name", "structure", "dt", "thresholds", "tolerance"), value


@pytest.mark.parametrize(
    "name", ["../structure.onnx", "{path}", "sub/structure.onnx", "..", "", "a\\b"]
)
def test_a_file_outside_the_folder_fails(name, copy, capsys) -> None:
    outside = copy.parent / "structure.onnx"
    shutil.copy(copy / "structure.onnx", outside)
    named = name.format(path=outside)
    change(copy, lambda m: m.update(files={named: m["files"]["structure.onnx"]}))
    assert not replay.verify(copy)
    assert f"{named}: FAILED: lies outside the folder" in capsys.readouterr().out


def test_a_link_to_elsewhere_fails(copy, capsys) -> None:
    outside = shutil.move(copy / "structure.onnx", copy.parent / "elsewhere.onnx")
    (copy / "structure.onnx").symlink_to(outside)
    assert not replay.verify(copy)
    assert "structure.onnx: FAILED: is a link" in capsys.readouterr().out


@pytest.mark.parametrize("entry", [None, 3, {}, {"sha256": 3}, {"runtime": "lisp"}], ids=str)
def test_an_entry_that_is_none_fails(entry, copy, capsys) -> None:
    if isinstance(entry, dict) and "runtime" in entry:
        entry |= {"sha256": hashlib.sha256((copy / "structure.ts").read_bytes()).hexdigest()}
    change(copy, lambda m: m["files"].update({"structure.ts": entry}))
    assert not replay.verify(copy)
    assert "structure.ts: FAILED: " in capsys.readouterr().out


@pytest.mark.parametrize("rows", [0, 5])
def test_a_record_without_steps_is_refused(rows, copy) -> None:
    with np.load(copy / "golden.npz") as file:
        record = dict(file)
    short = {k: v[:rows] if k.startswith("run/" if rows else ("run/", "pairs/")) else v
             for k, v in record.items()}  # fmt: skip
    short["run/input"] = record["run/input"][: rows and 20]
    np.savez(copy / "golden.npz", **short)
    with pytest.raises(reading.Unfit, match=r"golden.npz is damaged .*: export again"):
        replay.verify(copy)


def test_a_record_that_unpacks_to_very_much_is_refused(copy, monkeypatch) -> None:
    monkeypatch.setattr(reading, "LARGEST", 1000)
    with pytest.raises(reading.Unfit, match="more than 1000 bytes"):
        replay.verify(copy)


def test_the_command_ends_with_1_for_a_bad_export_and_2_for_none(copy, tmp_path) -> None:
    command = [sys.executable, "-m", "dntorch.cli", "verify"]

    def ends(*arguments: object) -> tuple[int, str]:
        done = subprocess.run(
            [*command, *map(str, arguments)], capture_output=True, text=True, timeout=200
        )
        assert "Traceback" not in done.stderr
        return done.returncode, done.stderr

    code, errors = ends(tmp_path)
    assert code == 2 and errors.count("\n") == 1 and "name a folder of an export" in errors
    mark = tmp_path / "ran"
    (copy / "verify.py").write_text(expression(mark))  # that of the sender is not run
    sign(copy, "export")
    assert ends("--trust", copy) == (0, "")
    change(copy, lambda m: m.update(files={}))
    code, errors = ends(copy)
    assert code == 1 and errors.count("\n") == 1 and "lists no artefact" in errors
    assert not mark.exists()


def test_a_program_that_ends_its_process_fails(copy, monkeypatch, capfd) -> None:
    killed = "import os\nos.kill(os.getpid(), 9)\n"
    monkeypatch.setitem(verify.__globals__, "checking_program", lambda: killed)
    assert not verify(copy)
    assert "ended its process with signal 9: do not use it" in capfd.readouterr().out


@pytest.mark.parametrize("size", [1000, 12_000])
def test_an_export_to_a_full_disk_is_one_sentence(size, tmp_path) -> None:
    rows, (_, most) = [(torch.rand(3),)] * 20, resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))  # the error of a full disk
    try:
        with pytest.raises(OSError, match=r"^\S+ cannot be written \(File too large\): make room"):
            export_structure(dntorch.NodeWTA(3), tmp_path, rows, ["torchscript", "export"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert not [*tmp_path.glob(".*")] and not (tmp_path / "manifest.json").exists()

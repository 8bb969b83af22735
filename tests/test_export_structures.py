"""Every public structure exports, with its state behind named tensors, and keeps its numbers."""

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest
import torch

import dntorch
from dntorch import modules
from dntorch.dynamics import Dynamics
from dntorch.export import Boundary, Functional, export_structure, replay, script

N, STEPS = 3, 60


def unit(*shape):
    return lambda step: torch.rand(shape, generator=torch.Generator().manual_seed(step))


def strong(*shape):
    return lambda step: 8 * unit(*shape)(step)


def photo(step):
    return (256 * unit(6, 13, 3)(step)).to(torch.uint8)


def small_camera():
    return dntorch.FindColor("RGB", hues=12, columns=13)


PAIRS = (N, N)
CASES: dict[str, tuple[Callable[[], Dynamics], tuple[Callable, ...]]] = {
    "DNF": (lambda: dntorch.DNF((5, 6), integrator="heun"), (strong(5, 6),)),
    "NodeWTA": (lambda: dntorch.NodeWTA(N), (strong(N),)),
    "TPCell": (lambda: dntorch.TPCell(PAIRS), (unit(*PAIRS),)),
    "ItemOrderWM": (lambda: dntorch.ItemOrderWM(N), (unit(*PAIRS),)),
    "ValueOpposition": (lambda: dntorch.ValueOpposition(N), (unit(*PAIRS),) * 3),
    "HebbianQ": (lambda: dntorch.HebbianQ(N), (unit(*PAIRS), unit(*PAIRS), unit(), unit())),
    "ValueNodes": (lambda: dntorch.ValueNodes(N), (unit(N), unit(*PAIRS))),
    "ElementaryBehaviors": (lambda: dntorch.ElementaryBehaviors(N), (unit(N), unit(N))),
    "Learner": (lambda: dntorch.Learner(N), (unit(N), unit(N), unit())),
    "Direct": (dntorch.Direct, (unit(N), unit(N))),
    "FindColor": (small_camera, (photo, unit(N))),
    "DNSarsa": (lambda: dntorch.DNSarsa(N), (unit(N), unit(), strong(*PAIRS))),
}


def test_no_structure_is_forgotten() -> None:
    parts = [
        import_module(found.name) for found in iter_modules(modules.__path__, "dntorch.modules.")
    ]
    defined = {
        name
        for part in parts
        for name, kind in vars(part).items()
        if inspect.isclass(kind) and issubclass(kind, Dynamics) and kind.__module__ == part.__name__
    }
    assert defined == set(CASES)
    assert defined < set(dntorch.__all__)  # all are public


@pytest.mark.parametrize("name", CASES)
def test_structure_scripts_exports_and_verifies(name: str, tmp_path: Path, capsys) -> None:
    build, sources = CASES[name]
    rows = [[source(100 * k + step) for k, source in enumerate(sources)] for step in range(STEPS)]
    export_structure(build(), tmp_path, rows)
    well, printed = replay.verify(tmp_path), capsys.readouterr().out
    assert well, printed
    for artefact in ("structure.ts", "structure.pt2", "structure.onnx"):
        assert f"{artefact}: ok" in printed


@pytest.mark.parametrize("name", CASES)
def test_names_lead_to_states_and_back(name: str) -> None:
    build, sources = CASES[name]
    boundary = Boundary(build(), *(source(0) for source in sources))
    state = boundary.structure.state
    flat = boundary.flatten(state)
    assert list(flat) == [port.name for port in boundary.state]
    assert boundary.flatten(boundary.unflatten(flat)).keys() == flat.keys()
    assert type(boundary.unflatten(flat)) is type(state)
    buffers = dict(boundary.structure.named_buffers())
    for path, buffer in boundary.buffers().items():
        assert torch.equal(flat[path], buffers[buffer])


def test_an_artefact_shares_no_memory_with_its_source() -> None:
    source = dntorch.NodeWTA(N)
    scripted = script(Boundary(source, torch.zeros(N)))
    scripted(torch.ones(N))
    assert torch.equal(source.u, torch.full((N,), -5.0))


def test_a_function_with_a_number_that_is_not_finite_stands_still() -> None:
    functional = Functional(Boundary(dntorch.NodeWTA(N), torch.zeros(N)))
    state = torch.tensor([1.0, -2.0, -5.0])
    for input, before in ((torch.tensor([0.0, torch.nan, 0.0]), state), (state, state * torch.inf)):
        valid, output, after = functional(input, before)
        assert not valid and torch.equal(output, torch.zeros(N)) and torch.equal(after, before)
    valid, output, after = functional(state, state)
    assert valid and output.any() and not torch.equal(after, state)


def test_an_unknown_runtime_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'tflite' is unknown: choose from torchscript"):
        export_structure(dntorch.NodeWTA(N), tmp_path, [[torch.zeros(N)]], ["tflite"])


def test_a_missing_exporter_names_its_remedy(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"executorch is not installed: .*dntorch\[executorch\]"):
        export_structure(dntorch.NodeWTA(N), tmp_path, [[torch.zeros(N)]], ["executorch"])


def test_a_compiled_program_verifies(tmp_path: Path, capsys) -> None:
    rows = [[strong(N)(step)] for step in range(STEPS)]
    export_structure(dntorch.NodeWTA(N), tmp_path, rows, ["aotinductor"])
    assert replay.verify(tmp_path), capsys.readouterr().out

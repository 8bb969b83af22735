"""Every public structure exports, with its state behind named tensors, and keeps its numbers."""

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.utils._pytree import tree_map

import dntorch
from dntorch import modules
from dntorch.dynamics import Dynamics
from dntorch.export import RUNTIMES, Boundary, Functional, export_structure, replay, script
from dntorch.export.artefacts import DEFAULT

N, STEPS = 3, 60


def unit(*shape):
    return lambda step: torch.rand(shape, generator=torch.Generator().manual_seed(step))


def strong(*shape):
    return lambda step: 8 * unit(*shape)(step)


def photo(step):
    return (256 * unit(6, 13, 3)(step)).to(torch.uint8)


def seen(**sources):
    """An observation by name."""
    return lambda step: {name: source(step) for name, source in sources.items()}


def small_camera(colors="RGB"):
    return dntorch.FindColor(colors, hues=12, columns=13)


def two_kinds():
    return dntorch.Repertoire(small_camera("RG"), small_camera("BY"))


class NearState(NamedTuple):
    near: Tensor
    side: Tensor


class KeepOff(dntorch.Sensorimotor[NearState]):
    """Always on: turns away from what is near. One tensor of its state never changes."""

    senses = ("proximity",)
    n = 0

    def __init__(self) -> None:
        super().__init__(max_speed=1.0)

    def initial(self, batch: list[int]) -> NearState:
        return NearState(self.origin.new_zeros(batch), self.origin.new_ones(batch))

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: NearState
    ) -> NearState:
        return NearState(state.near.lerp(observation["proximity"].amax(-1), 0.2), state.side)

    def act(self, intention: Tensor, state: NearState) -> Tensor:
        away = state.near * state.side
        return torch.stack((away, -away), -1)


def coupled(*order, trace=True):
    """Fields, and a memory trace that one of them leaves."""
    parts = {"scene": dntorch.DNF((2, 4), ()), "space": dntorch.DNF(4, dntorch.Gauss(6.0, 1.0))}
    links = [("scene", "space", "c p -> p"), ("space", "scene", "p -> c p", 2.0)]
    links += [("the cue (left)", "space")]
    if trace:
        parts["trace"] = dntorch.MemoryTrace(4)
        links += [("space", "trace"), ("trace", "space", 2.0)]
    return dntorch.Architecture(parts, *links, inputs={"the cue (left)": 4}, order=order or None)


FED = (seen(**{"scene": strong(2, 4), "space": strong(4), "the cue (left)": strong(4)}),)
PAIRS = (N, N)
CASES: dict[str, tuple[Callable[[], Dynamics], tuple[Callable, ...]]] = {
    "DNF": (lambda: dntorch.DNF((5, 6), integrator="heun"), (strong(5, 6),)),
    "MemoryTrace": (lambda: dntorch.MemoryTrace((2, 3)), (unit(2, 3),)),
    "Architecture": (coupled, FED),
    "Folded": (lambda: coupled(trace=False).fold(), FED),
    "NodeWTA": (lambda: dntorch.NodeWTA(N), (strong(N),)),
    "TPCell": (lambda: dntorch.TPCell(PAIRS), (unit(*PAIRS),)),
    "ItemOrderWM": (lambda: dntorch.ItemOrderWM(N), (unit(*PAIRS),)),
    "ValueOpposition": (lambda: dntorch.ValueOpposition(N), (unit(*PAIRS),) * 3),
    "HebbianQ": (lambda: dntorch.HebbianQ(N), (unit(*PAIRS), unit(*PAIRS), unit(), unit())),
    "ValueNodes": (lambda: dntorch.ValueNodes(N), (unit(N), unit(*PAIRS), unit(N), unit(N))),
    "ElementaryBehaviors": (lambda: dntorch.ElementaryBehaviors(N), (unit(N), unit(N))),
    "Learner": (lambda: dntorch.Learner(N), (unit(N), unit(N), unit())),
    "Recall": (lambda: dntorch.Recall(N, 2), (unit(N),)),
    "Habituation": (lambda: dntorch.Habituation(N, 2), (unit(N), unit(N))),
    "Dissatisfaction": (lambda: dntorch.Dissatisfaction(N, patience=0.5), (unit(N),)),
    "Constraints": (lambda: dntorch.Constraints(N), (unit(N), unit(N), unit(N), unit(*PAIRS))),
    "Curiosity": (lambda: dntorch.Curiosity(N, 3), (unit(N), unit(1))),
    "Direct": (dntorch.Direct, (seen(match=unit(N)), unit(N))),
    "FindColor": (small_camera, (seen(image=photo), unit(N))),
    "Repertoire": (two_kinds, (seen(image=photo), unit(4))),
    "DNSarsa": (lambda: dntorch.DNSarsa(N), (seen(match=unit(N)), unit(), strong(N))),
}


def rows_of(sources, steps=STEPS):
    """Inputs of some steps, other ones each."""
    return [[source(100 * k + step) for k, source in enumerate(sources)] for step in range(steps)]


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
    # The base of some, and what test_export_agent.py exports within an agent that has every part.
    assert defined == {*CASES, "Sensorimotor", "Deliberation"}
    assert defined < set(dntorch.__all__)  # all are public


@pytest.mark.parametrize("name", CASES)
def test_structure_scripts_exports_and_verifies(name: str, tmp_path: Path, capsys) -> None:
    build, sources = CASES[name]
    export_structure(build(), tmp_path, rows_of(sources))
    well, printed = replay.verify(tmp_path), capsys.readouterr().out
    assert well, printed
    for artefact in ("structure.ts", "structure.pt2", "structure.onnx"):
        assert f"{artefact}: ok" in printed


@pytest.mark.parametrize("name", CASES)
def test_ports_are_the_tensors_of_a_step_by_name(name: str) -> None:
    build, sources = CASES[name]
    inputs = [source(0) for source in sources]
    boundary = Boundary(build(), *inputs)
    named = boundary.named(inputs)
    assert list(named) == [port.name for port in boundary.inputs]
    assert boundary.arguments(named) == inputs  # the same objects
    flat = boundary.structure.flat(boundary.structure.state)
    assert list(flat) == [port.name for port in boundary.state]
    for path, tensor in flat.items():
        assert torch.equal(tensor, boundary.structure.get_buffer(path))


def test_of_an_observation_only_what_is_sensed_goes_in() -> None:
    observation = {"wheels": torch.zeros(2), "match": torch.zeros(N), "image": photo(0)}
    agent = dntorch.DNSarsa(N)
    boundary = Boundary(agent, observation, torch.zeros(()), torch.zeros(N))
    assert [port.name for port in boundary.inputs] == ["match", "reward", "noise"]
    assert [port.name for port in boundary.outputs] == ["action"]
    with pytest.raises(ValueError, match="the observation lacks 'match'"):
        Boundary(agent, {"image": photo(0)}, torch.zeros(()), torch.zeros(N))


class Odd(dntorch.Sensorimotor[dict[str, Tensor]]):
    """Reads what the test says; one behaviour."""

    n = 1

    def __init__(self, sense: str) -> None:
        super().__init__()
        self.senses = (sense,)

    def match(self, observation: dict[str, Tensor], state: dict[str, Tensor]) -> Tensor:
        return observation[self.senses[0]]

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: dict[str, Tensor]
    ) -> dict[str, Tensor]:
        return state

    def act(self, intention: Tensor, state: dict[str, Tensor]) -> Tensor:
        return intention.clone()


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("intention", "two tensors of Odd are called 'intention': choose another key"),
        ("action", "two tensors of Odd are called 'action': choose another key"),
        ("left camera", "'left camera' cannot name an argument"),
        ("lambda", "'lambda' cannot name an argument"),
    ],
)
def test_a_name_that_cannot_be_that_of_a_port_is_refused(key, says) -> None:
    with pytest.raises(ValueError, match=says):
        Boundary(Odd(key), {key: torch.zeros(1)}, torch.zeros(1))


@pytest.mark.parametrize(
    ("label", "port"),
    [("cue", "cue"), ("a cue", "a_x20_cue"), ("2nd", "input_2nd"), ("lambda", "input_lambda")],
)
def test_labels_of_an_architecture_name_ports_in_an_escaped_form(label, port) -> None:
    model = dntorch.Architecture({label: dntorch.DNF(3)})
    boundary = Boundary(model, {label: torch.ones(3)})
    assert [each.name for each in boundary.inputs] == [port]
    scripted = script(boundary)
    assert torch.equal(scripted(torch.ones(3)), model({label: torch.ones(3)})[label])


def test_a_state_that_bears_other_names_than_its_buffers_is_refused() -> None:
    nodes = dntorch.NodeWTA(N)
    nodes.flat = lambda state: {"activation": state.u}
    with pytest.raises(ValueError, match="no buffer is called 'activation' as the state is"):
        Boundary(nodes, torch.zeros(N))


def test_an_artefact_shares_no_memory_with_its_source() -> None:
    source = dntorch.NodeWTA(N)
    scripted = script(Boundary(source, torch.zeros(N)))
    scripted(torch.ones(N))
    assert torch.equal(source.u, torch.full((N,), -5.0))


def artefact(folder: Path, runtime: str):
    """An exported structure behind the face of `replay`."""
    manifest, _ = replay.read(folder)
    return replay.LOADERS[runtime](folder / f"structure{RUNTIMES[runtime]}", manifest)


def arrays(tensors: dict[str, Tensor]) -> dict[str, np.ndarray]:
    return {name: tensor.numpy() for name, tensor in tensors.items()}


def spoiled(value, number: float, batch: tuple[int, ...]):
    """An input with a number that is not finite, in one member of a batch if there is one."""

    def spoil(tensor: Tensor) -> Tensor:
        if not tensor.is_floating_point():
            return tensor
        tensor = tensor.clone()
        (tensor[1] if batch else tensor).view(-1)[-1] = number
        return tensor

    return tree_map(spoil, value)


AGENTS: dict[str, tuple[Callable, Callable, tuple[int, ...]]] = {
    "match": (lambda: dntorch.DNSarsa(N), seen(match=unit(N)), ()),
    "batch": (lambda: dntorch.DNSarsa(N).spread(2), seen(match=unit(2, N)), (2,)),
    "camera": (lambda: dntorch.DNSarsa(N, small_camera()), seen(image=photo), ()),
    "repertoire": (lambda: dntorch.DNSarsa(4, two_kinds()), seen(image=photo), ()),
    "several senses": (
        lambda: dntorch.DNSarsa(N, dntorch.Repertoire(small_camera(), KeepOff())),
        seen(wheels=unit(2), proximity=unit(8), image=photo),
        (),
    ),
}


@pytest.mark.parametrize("name", AGENTS)
def test_an_exported_agent_ignores_and_counts_as_the_module_does(name: str, tmp_path: Path) -> None:
    build, observe, batch = AGENTS[name]
    agent = build()
    agent.learner.trace.u.fill_(0.5)  # so that it learns from the first reward on
    each = (*batch, agent.n)
    rows = rows_of((observe, unit(*batch), strong(*each)), 40)
    for step, k, number in ((5, 1, torch.nan), (12, 2, torch.inf), (19, 0, torch.nan)):
        rows[step][k] = spoiled(rows[step][k], number, batch)
    export_structure(agent, tmp_path, rows)
    boundary = Boundary(agent, *rows[0])
    assert [port.name for port in boundary.inputs] == [*agent.senses, "reward", "noise"]
    exported = {runtime: artefact(tmp_path, runtime) for runtime in DEFAULT}
    learning = {"learner.values.learning": np.ones((), np.float32)}
    for row in rows:
        expected = {"action": agent(*row)} | agent.flat(agent.state)
        for runtime, one in exported.items():
            actual = one.step(arrays(boundary.named(row)), learning) | one.state()
            tolerance = 1e-5 if runtime == "onnx" else 0
            for key, tensor in expected.items():
                assert replay.difference(actual[key], tensor.numpy()) <= tolerance, (runtime, key)
    floats = any(key in agent.senses for key in ("match", "proximity"))
    assert agent.ignored.tolist() == ([0, 2 + floats] if batch else 2 + floats)
    assert agent.weights.isfinite().all() and (agent.weights > 1e-3).any()


def test_other_structures_let_nan_spread_as_they_do_eagerly(tmp_path: Path) -> None:
    nodes, bad = dntorch.NodeWTA(N), torch.tensor([1.0, torch.nan, 2.0])
    export_structure(nodes, tmp_path, [[torch.ones(N)]])
    expected, held = nodes(bad), nodes.u
    assert expected.isnan().any()
    for runtime in DEFAULT:
        one = artefact(tmp_path, runtime)
        out = one.step({"input": bad.numpy()}, {})
        np.testing.assert_array_equal(np.isnan(out["output"]), expected.isnan())
        np.testing.assert_array_equal(np.isnan(one.state()["u"]), held.isnan())
    outputs = Functional(Boundary(dntorch.NodeWTA(N), bad))(bad, torch.full((N,), -5.0))
    torch.testing.assert_close(outputs, (expected, held), equal_nan=True)


def learned_rate():
    values = dntorch.HebbianQ(N, learning_rate=nn.Parameter(torch.tensor(0.3)))
    return dntorch.Learner(N, values=values)


PARAMETERS = {
    "one for all": (lambda: dntorch.NodeWTA(N, tau=torch.tensor(0.2)), (strong(N),), "tau"),
    "one each": (
        lambda: dntorch.DNF(5, tau=torch.tensor([0.1, 0.4])), (strong(2, 5),), "tau",
    ),
    "learned": (learned_rate, CASES["Learner"][1], "values.learning_rate"),
}  # fmt: skip


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_parameter_that_is_a_tensor_is_one_of_the_program(name: str, tmp_path, capsys) -> None:
    build, sources, path = PARAMETERS[name]
    structure = build()
    export_structure(structure, tmp_path, rows_of(sources))
    well, printed = replay.verify(tmp_path), capsys.readouterr().out
    assert well and printed.count("structure.") >= len(DEFAULT), printed
    expected = structure.snapshot()[path]
    program = torch.export.load(tmp_path / "structure.pt2")
    held = program.state_dict | program.constants
    (tensor,) = [x for key, x in held.items() if key.endswith("structure." + path)]
    assert torch.equal(tensor, expected)
    scripted = torch.jit.load(tmp_path / "structure.ts").structure
    (tensor,) = [x for key, x in tensors(scripted) if key == path]
    assert torch.equal(tensor, expected) and not tensor.requires_grad
    assert all(x.requires_grad for x in structure.parameters())  # the original is as it was


def tensors(module):
    return [*module.named_buffers(), *module.named_parameters()]


def test_an_unknown_runtime_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'tflite' is unknown: choose from torchscript"):
        export_structure(dntorch.NodeWTA(N), tmp_path, [[torch.zeros(N)]], ["tflite"])


def test_a_missing_exporter_names_its_remedy(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"executorch is not installed: .*dntorch\[executorch\]"):
        export_structure(dntorch.NodeWTA(N), tmp_path, [[torch.zeros(N)]], ["executorch"])


def test_a_compiled_program_verifies(tmp_path: Path, capsys) -> None:
    rows = rows_of(CASES["DNSarsa"][1])
    rows[5][1], rows[12][2] = torch.tensor(torch.nan), spoiled(rows[12][2], torch.inf, ())
    export_structure(dntorch.DNSarsa(N), tmp_path, rows, ["aotinductor"])
    assert not replay.verify(tmp_path) and "give --trust" in capsys.readouterr().out
    assert replay.verify(tmp_path, trust=True), capsys.readouterr().out
    _, record = replay.read(tmp_path)
    assert record["run/next.ignored"][-1] == 2

"""Parameters as promises: checked whenever they are set, one number or one per agent."""

import copy
import inspect
import math
from typing import NamedTuple

import numpy as np
import pytest
import torch
from structures import CASES, N, assert_same, compiled, exported, jit, over, scripted, stream
from torch import Tensor, nn

from dntorch import (
    DNF,
    DNSarsa,
    Dynamics,
    ElementaryBehaviors,
    Gauss,
    Global,
    HebbianQ,
    Learner,
    Matrices,
    NodeWTA,
    Repertoire,
)
from dntorch.cells.field import FieldState
from dntorch.cells.kernels import gauss_matrix
from dntorch.modules.find_color import FindColor
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.transient import TPCell
from dntorch.modules.value import ValueNodes
from dntorch.modules.working_memory import ItemOrderWM

STRUCTURES = {
    "DNF": lambda **numbers: DNF(9, **numbers),
    "NodeWTA": lambda **numbers: NodeWTA(N, **numbers),
    "TPCell": lambda **numbers: TPCell((N, N), **numbers),
    "ItemOrderWM": lambda **numbers: ItemOrderWM(N, **numbers),
    "ValueOpposition": lambda **numbers: ValueOpposition(N, **numbers),
    "HebbianQ": lambda **numbers: HebbianQ(N, **numbers),
    "ValueNodes": lambda **numbers: ValueNodes(N, **numbers),
    "ElementaryBehaviors": lambda **numbers: ElementaryBehaviors(N, **numbers),
    "FindColor": lambda **numbers: FindColor("RGB", hues=12, columns=13, **numbers),
}
INPUTS = CASES | {"DNF": CASES["DNF 1-D"]}
CALLED = "dt"


def numbers_of(build):
    return [name for name in type(build()).numeric() if name != CALLED]


EVERY_NUMBER = [(s, name) for s, build in STRUCTURES.items() for name in numbers_of(build)]
every_number = pytest.mark.parametrize(("structure", "name"), EVERY_NUMBER)


def test_every_structure_has_numbers():
    assert len(EVERY_NUMBER) >= 35
    arguments = inspect.signature(NodeWTA.__init__).parameters
    assert {name for s, name in EVERY_NUMBER if s == "NodeWTA"} == set(arguments) - {
        "self", "n", "dt"
    }  # fmt: skip


@every_number
@jit
def test_a_whole_number_is_a_float(structure, name):
    build = STRUCTURES[structure]
    default = getattr(build(), name)
    default = -20.5 if default is None else default  # the floor, which has none
    whole = round(default) if abs(default) < math.inf else 2
    low, high = math.floor(default) if default < math.inf else 2, math.ceil(min(default, 2))
    for value in (whole, low, high):
        try:
            module = build(**{name: value})
        except ValueError:
            continue  # this one is out of bounds, whole or not
        assert type(getattr(module, name)) is float
        (inputs,) = stream(INPUTS[structure], 1)
        assert_same(torch.jit.script(copy.deepcopy(module))(*inputs), module(*inputs))
        return
    pytest.fail(f"no whole number fits {name}={default}")


@every_number
@pytest.mark.parametrize("wrong", [math.nan, -math.inf, "fast", None, True, [1.0]])
def test_what_is_no_finite_number_is_refused_and_changes_nothing(structure, name, wrong):
    build = STRUCTURES[structure]
    module = build()
    before, held = getattr(module, name), module.state
    if wrong is before is None:
        return  # no number is what there is
    with pytest.raises((ValueError, TypeError), match=f"{name}="):
        setattr(module, name, wrong)
    assert getattr(module, name) == before
    assert_same(module.state, held)
    may_be_none = inspect.signature(type(module).__init__).parameters[name].default is None
    if not (wrong is None and may_be_none):
        with pytest.raises((ValueError, TypeError), match=f"{name}="):
            build(**{name: wrong})


@pytest.mark.parametrize(
    ("structure", "name", "wrong"),
    [
        ("DNF", "tau", -1), ("DNF", "tau", 1 / 64), ("NodeWTA", "tau", 0),
        ("NodeWTA", "h", 5.0), ("NodeWTA", "floor", -4), ("TPCell", "tau", 0.01),
        ("ItemOrderWM", "excitation", -1),
        ("ItemOrderWM", "excitation", 40), ("ItemOrderWM", "threshold", -0.1),
        ("ValueOpposition", "discount", 1.5), ("ValueOpposition", "pulse_threshold", 0),
        ("HebbianQ", "learning_rate", 0), ("ValueNodes", "baseline", 0),
        ("ElementaryBehaviors", "value_gain", -5), ("FindColor", "axle", 0),
        ("FindColor", "max_speed", -1),
    ],
)  # fmt: skip
def test_a_wrong_value_is_refused_whenever_it_is_set(structure, name, wrong):
    build = STRUCTURES[structure]
    module = build()
    before = getattr(module, name)
    for attempt in (lambda: build(**{name: wrong}), lambda: setattr(module, name, wrong)):
        with pytest.raises(ValueError, match=name):
            attempt()
    assert getattr(module, name) == before
    with pytest.raises(ValueError, match=name):
        setattr(module, name, torch.tensor(float(wrong)))
    assert getattr(module, name) == before


@pytest.mark.parametrize(
    ("name", "wrong"), [("kind", "relu"), ("substeps", 0), ("integrator", "rk4")]
)
def test_choices_are_checked_too(name, wrong):
    field = DNF(9)
    before = getattr(field, name)
    with pytest.raises(ValueError, match=name):
        setattr(field, name, wrong)
    assert getattr(field, name) == before
    field.substeps, field.integrator, field.kind = 2, "heun", "abs"
    expected = DNF(9, substeps=2, integrator="heun", kind="abs")
    assert torch.equal(field(torch.ones(9)), expected(torch.ones(9)))


@pytest.mark.parametrize(
    ("build", "name", "value"),
    [
        (lambda: DNF(9), "dt", 1 / 64), (lambda: DNF(9), "shape", 11), (lambda: NodeWTA(3), "n", 4),
        (lambda: DNF(9), "border", "zero"), (lambda: FindColor(), "fov", 1.2),
        (lambda: DNSarsa(4, substeps=2), "substeps", 4),
        (lambda: ElementaryBehaviors(3), "dt", 0.1),
    ],
)  # fmt: skip
def test_what_was_built_in_is_not_changed_in_silence(build, name, value):
    module = build()
    before = getattr(module, name)
    with pytest.raises(ValueError, match=f"{name} is fixed when a"):
        setattr(module, name, value)
    assert getattr(module, name) == before


def test_a_misspelt_parameter_is_refused_and_tools_hang_on_what_they_like():
    field = DNF(9)
    for name in ("steepnes", "treshold", "substep_s", "Kernel"):
        with pytest.raises(AttributeError, match="did you mean"):
            setattr(field, name, 2.0)
    field.label, field._hook, field.epoch = "left", 3, 4  # as tools do
    field.probe = nn.Linear(2, 2)
    assert field.label == "left" and field.epoch == 4


def test_a_part_is_replaced_checked_and_resized():
    agent = DNSarsa(3).spread(2)
    other = NodeWTA(3, tau=0.2)
    agent.behaviors.intention = other
    assert other.state.u.shape == (2, 3)
    with pytest.raises(ValueError, match=r"intention\.n=4 does not fit n=3"):
        agent.behaviors.intention = NodeWTA(4)
    assert agent.behaviors.intention is other


def test_a_refused_part_leaves_everything_as_it_was():
    agent = DNSarsa(3).spread(2)
    learner, intention = agent.learner, agent.behaviors.intention
    with pytest.raises(ValueError, match="batch"):
        agent.learner = Learner(3).spread(3)
    with pytest.raises(TypeError, match="is no NodeWTA: give one"):
        agent.behaviors.intention = nn.Linear(3, 3)
    with pytest.raises(TypeError, match="is no NodeWTA: give one"):
        agent.behaviors.intention = TPCell((3,))
    with pytest.raises(TypeError, match="is no ElementaryBehaviors: give one"):
        DNSarsa(3, behaviors=5)
    assert agent.learner is learner and agent.behaviors.intention is intention
    agent({"match": torch.zeros(2, 3)}, torch.zeros(2), torch.zeros(2, 3))


def test_a_part_stands_in_one_place():
    eye, nodes = FindColor("RG", hues=12, columns=13), NodeWTA(3)
    with pytest.raises(ValueError, match=r"parts\.0 and parts\.1 are one part"):
        Repertoire(eye, eye)
    with pytest.raises(ValueError, match="intention and satisfaction are one part"):
        ElementaryBehaviors(3, nodes, nodes)


def test_a_structure_shows_what_it_is():
    assert "tau=0.3, h=-5.0, excitation=10.0" in repr(NodeWTA(3))
    assert "n=3" in repr(NodeWTA(3)) and "kernel=(Gauss" in repr(DNF(9))
    assert "tau=tensor" in repr(NodeWTA(3, tau=torch.tensor([0.1, 0.2])))


# One number per agent

VARYING = [
    ("DNF", "tau", (0.1, 0.2)), ("DNF", "h", (-5.0, -2.0)), ("NodeWTA", "tau", (0.1, 0.3)),
    ("NodeWTA", "h", (-5.0, -3.0)), ("NodeWTA", "excitation", (10.0, 4.0)),
    ("NodeWTA", "inhibition", (10.0, 30.0)), ("TPCell", "tau", (0.2, 0.5)),
    ("ItemOrderWM", "tau", (0.5, 1.0)), ("ItemOrderWM", "excitation", (1.0, 2.0)),
    ("ItemOrderWM", "feedback", (0.4, 0.8)), ("ValueOpposition", "discount", (0.5, 0.9)),
    ("ValueOpposition", "tau", (0.1, 0.2)), ("ValueOpposition", "tau_error", (0.1, 0.2)),
    ("ValueOpposition", "pulse_threshold", (0.05, 0.6)),
    ("ValueOpposition", "trace_threshold", (0.01, 0.5)),
    ("HebbianQ", "learning_rate", (0.1, 0.5)), ("ValueNodes", "tau", (0.1, 0.4)),
    ("ValueNodes", "baseline", (1e-3, 0.5)), ("ElementaryBehaviors", "value_gain", (15.0, 20.0)),
    ("ElementaryBehaviors", "completion_gain", (30.0, 40.0)),
    ("ElementaryBehaviors", "intention_gain", (1.0, 2.0)),
    ("ElementaryBehaviors", "match_gain", (10.0, 15.0)),
]  # fmt: skip
varying = pytest.mark.parametrize(("structure", "name", "values"), VARYING)


@varying
@pytest.mark.parametrize("translate", [None, scripted, compiled, exported])
@jit
def test_one_number_per_agent_is_that_agent_alone(structure, name, values, translate):
    build = STRUCTURES[structure]
    module = build().spread(2)
    setattr(module, name, torch.tensor(values))
    module.reset()  # a resting level that is set is where the next reset leads to
    inputs = list(stream(INPUTS[structure], 12, 2))
    twin = translate(copy.deepcopy(module), inputs[0]) if translate else module
    alone = [build() for _ in values]
    for each, value in zip(alone, values, strict=True):
        setattr(each, name, value)
        each.reset()
    for batch in inputs:
        together = twin(*batch)
        for k, each in enumerate(alone):
            single = each(*torch.utils._pytree.tree_map(lambda x, k=k: x[k], batch))
            own = torch.utils._pytree.tree_map(lambda x, k=k: x[k], together)
            assert_same(own, single, exactly=False)


@varying
def test_numbers_per_agent_move_are_kept_and_are_split(structure, name, values):
    build = STRUCTURES[structure]
    derived = {"completion_gain": 30.0} if name == "value_gain" else {}
    module = build(**{name: torch.tensor(values)}, **derived)
    assert tuple(module.origin.shape) == (2,)  # the batch of the numbers
    assert dict(module.named_buffers())[name].tolist() == pytest.approx(values)
    assert name in module.snapshot() and name not in module.state_dict()
    assert getattr(copy.deepcopy(module).double(), name).dtype == torch.float64
    one = module.select(1)
    assert getattr(one, name) == pytest.approx(values[1]) and one.origin.shape == ()
    assert type(getattr(one, name)) is float
    for change in (module.resize, module.spread):
        with pytest.raises(
            ValueError, match=rf"{name} of shape \[2\] does not fit the batch \[3\]"
        ):
            change(3)
    assert tuple(module.origin.shape) == (2,)
    setattr(module, name, values[0])
    module.resize(3)


def test_numbers_per_agent_inside_an_agent():
    agent = DNSarsa(3).spread(4)
    with pytest.raises(ValueError, match=r"tau of shape \[3\] does not fit the batch \[4\]"):
        agent.learner.trace.tau = torch.tensor([0.5, 1.0, 2.0])
    agent.learner.trace.tau = torch.tensor([0.5, 1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"learner\.trace\.tau of shape \[4\]"):
        agent.resize(2)
    assert agent.select(2).learner.trace.tau == 2.0
    with pytest.raises(ValueError, match="tau"):
        agent.learner.trace.tau = torch.tensor([0.5, -1.0, 2.0, 3.0])
    assert agent.learner.trace.tau[1] == 1.0


def test_a_number_is_not_the_tensor_of_the_caller():
    own = torch.tensor([0.2, 0.3])
    a, b = NodeWTA(3, tau=own), NodeWTA(3, tau=own)
    own[0] = -5.0
    assert a.tau.tolist() == pytest.approx([0.2, 0.3])
    a.restore({**a.snapshot(), "tau": torch.tensor([0.5, 0.6])})
    assert b.tau.tolist() == pytest.approx([0.2, 0.3])
    shared = NodeWTA(3, tau=torch.tensor(0.3).expand(2))
    shared.restore(shared.snapshot())


def test_a_snapshot_with_bad_numbers_is_refused_and_changes_nothing():
    nodes = NodeWTA(3, tau=torch.tensor([0.2, 0.3]))
    before = nodes.snapshot()
    for wrong in ([-1.0, 0.3], [0.2, math.nan]):
        with pytest.raises(ValueError, match="tau="):
            nodes.restore({**before, "tau": torch.tensor(wrong), "u": torch.ones(2, 3)})
        assert_same(nodes.snapshot(), before)


@pytest.mark.parametrize("wrong", [-1.0, 0, math.nan, np.float32(-1), torch.tensor(0.0)])
def test_a_wrong_duration_of_a_step_is_refused(wrong):
    with pytest.raises(ValueError, match="dt="):
        HebbianQ(3, dt=wrong)


def test_state_is_cut_off_from_a_resting_level_that_is_learned():
    nodes = NodeWTA(3, h=nn.Parameter(torch.tensor(-5.0)))
    for _ in range(5):
        nodes(torch.ones(3))
    assert not nodes.u.requires_grad and not nodes.state.u.requires_grad


def test_a_time_constant_can_be_learned():
    nodes = NodeWTA(3, tau=nn.Parameter(torch.tensor(0.3)), h=nn.Parameter(torch.tensor(-5.0)))
    assert {name for name, _ in nodes.named_parameters()} == {"tau", "h"}
    state = nodes.initial([2])
    for _ in range(4):
        _, state = nodes.step(torch.full((2, 3), 6.0), state)
    state.u.sum().backward()
    assert nodes.tau.grad != 0 and nodes.h.grad != 0


# Kernels


def test_a_kernel_reads_as_terms_and_is_rebuilt_when_set():
    terms = (Gauss(8.0, 2.0), Global(-0.5))
    field, built = DNF(15), DNF(15, terms)
    field.kernel = terms
    assert field.kernel == terms
    stimulus = 7 * torch.rand(15, generator=torch.Generator().manual_seed(0))
    for _ in range(16):
        assert torch.equal(field(stimulus), built(stimulus))
    with pytest.raises(ValueError, match=r"Gauss\(amplitude=1.0, sigma=-2"):
        field.kernel = (Gauss(1.0, -2.0),)
    assert field.kernel == terms


def test_a_kernel_is_differentiable_in_its_numbers():
    amplitude, sigma = torch.tensor(8.0, requires_grad=True), torch.tensor(2.0, requires_grad=True)
    depth = torch.tensor(-0.5, requires_grad=True)
    for shape in (15, (6, 7)):
        field = DNF(shape)
        field.kernel = (Gauss(amplitude, sigma), Global(depth))
        stimulus = torch.linspace(0, 18, math.prod(field.shape)).view(field.shape)
        _, state = field.step(stimulus, field.initial([]))
        _, state = field.step(stimulus, state)
        (state.u * torch.arange(state.u.numel()).view(state.u.shape)).sum().backward()
        assert all(x.grad != 0 for x in (amplitude, sigma, depth))
        copy.deepcopy(field)


def test_a_field_with_a_kernel_of_tensors_is_copied():
    width = torch.tensor(0.5, requires_grad=True)
    for term in (Gauss(width.exp(), width + 1), Gauss(2.0, (width + 1, width + 2))):
        field = DNF((5, 4))
        field.kernel = (term,)
        twin = copy.deepcopy(field)
        stimulus = 8 * torch.ones(5, 4)
        assert torch.equal(twin(stimulus), field(stimulus).detach())


@pytest.mark.parametrize("shape", [(), 9, (4, 5), (2, 3, 4)])
def test_a_global_term_belongs_to_a_snapshot(shape):
    a, b = (DNF(shape, (Gauss(3.0, 1.0), Global(depth))) for depth in (-2.0, -0.1))
    b.restore(a.snapshot())
    stimulus = 8 * torch.ones(a.shape)
    for _ in range(3):
        assert torch.equal(a(stimulus), b(stimulus))
    assert b.kernel != (Gauss(3.0, 1.0), Global(-0.1))
    again = DNF(shape, b.kernel)
    again(stimulus)


def test_changed_matrices_read_as_matrices_and_belong_to_a_snapshot():
    a, b = DNF(9), DNF(9)
    a.kernel_0 = nn.Parameter(a.kernel_0.detach())
    b.kernel_0 = nn.Parameter(b.kernel_0.detach())
    with torch.no_grad():
        a.kernel_0 += 0.1
    assert isinstance(a.kernel[0], Matrices)
    b.restore(a.snapshot())
    assert torch.equal(a(8 * torch.ones(9)), b(8 * torch.ones(9)))
    assert torch.equal(DNF(9, a.kernel).kernel_0, a.kernel_0)
    a.kernel = (Gauss(3.0, 1.0),)
    assert a.kernel == (Gauss(3.0, 1.0),) and not list(a.parameters())


@pytest.mark.parametrize(
    ("term", "border"),
    [
        (Gauss(5.0, 1.5, shift=20.0), "zero"), (Gauss(5.0, 0.01, shift=0.5), "circular"),
        (Gauss(math.nan, 1.0), "zero"), (Gauss(1.0, math.inf), "zero"),
        (Gauss(1.0, 1.0, shift=math.nan), "zero"), (Global(math.inf), "zero"),
        (Gauss(5.0, 0.01, shift=0.5), "zero"), (Gauss("wide", 1.0), "zero"),
        (Matrices((torch.full((11, 11), math.nan),)), "zero"),
    ],
)  # fmt: skip
def test_a_term_without_effect_or_sense_is_named(term, border):
    with pytest.raises(ValueError, match=f"^{type(term).__name__}"):
        DNF(11, (term,), border=border)


def test_a_shift_keeps_the_size_of_taps_near_a_zero_border():
    still, moved = (gauss_matrix(11, 2.0, "zero", shift) for shift in (0.0, 10.0))
    assert float(still[5, 5]) == pytest.approx(0.1995, abs=1e-3)
    assert float(moved[10, 0]) == pytest.approx(float(still[5, 5]), abs=1e-3)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: DNF(3.5), r"shape=3\.5: give a number of sites"),
        (lambda: DNF("9"), r"shape='9': give a number of sites"),
        (lambda: DNF((3, 2.5)), r"shape=\(3, 2\.5\): give a number of sites"),
        (lambda: DNF(9, kernel="mexican"), "kernel='mexican' is no kernel: give terms"),
        (lambda: DNF(9, kernel=3.0), "kernel=3.0 is no kernel: give terms"),
        (lambda: DNF(9, kernel=(Gauss(1.0, 1.0), 2)), "is no kernel: give terms"),
    ],
)
def test_what_makes_no_field_is_refused_in_one_sentence(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    "build",
    [
        lambda: NodeWTA(3.5), lambda: NodeWTA(0), lambda: HebbianQ(2.5), lambda: HebbianQ(0),
        lambda: ItemOrderWM(-1), lambda: ValueOpposition("4"), lambda: ValueNodes(1),
        lambda: TPCell(3), lambda: TPCell((3, 0)), lambda: FindColor(columns=0),
        lambda: FindColor(hues=2.5), lambda: DNF(9, substeps="2"), lambda: DNF(9, substeps=1.5),
        lambda: DNSarsa(4, substeps=1.5), lambda: Learner(0), lambda: DNSarsa(True),
        lambda: ElementaryBehaviors(1),
    ],
)  # fmt: skip
def test_numbers_of_things_are_whole(build):
    with pytest.raises(ValueError, match=r"^(n|shape|columns|hues|substeps)=.*: give a"):
        build()


def test_a_kernel_moved_to_float64_is_the_same_kernel():
    terms = (Gauss(8.0, 2.0), Global(-0.3))
    for field in (DNF(9, terms).double(), DNF((4, 5), terms).double(), DNF(9, terms)):
        assert field.kernel == terms


def test_a_term_of_several_numbers_is_named():
    with pytest.raises(ValueError, match=r"Gauss\(.*amplitude has 2 numbers: give one"):
        DNF(9, (Gauss(torch.tensor([1.0, 2.0]), 1.0),))


class OwnState(NamedTuple):
    field: FieldState


class Own(Dynamics[OwnState]):
    """A composite that hands its input to a field."""

    def __init__(self, substeps=1):
        super().__init__(1 / 32)
        self.field = DNF(9, substeps=substeps)

    def euler(self, input: Tensor, state: OwnState) -> OwnState:
        return OwnState(self.field.euler(input, state.field))

    def output(self, state: OwnState) -> Tensor:
        return self.field.output(state.field)


def test_a_field_in_a_composite_checks_its_input_and_runs_at_full_speed():
    with pytest.raises(ValueError, match=r"input of shape \[1\] does not end in \[9\]"):
        Own()(torch.zeros(1))
    with pytest.raises(ValueError, match=r"input of dtype torch.float64 does not fit"):
        Own()(torch.zeros(9, dtype=torch.float64))
    with pytest.raises(TypeError, match="input is a ndarray"):
        Own()(torch.zeros(9).numpy())
    stimulus = torch.linspace(0, 8, 9)
    whole, field = Own(2), DNF(9, substeps=2)
    for _ in range(4):
        assert torch.equal(whole(stimulus), field(stimulus))


@over({k: v for k, v in CASES.items() if k != "Direct"})
def test_an_input_that_is_no_tensor_is_refused_in_one_sentence(case):
    module = case.build()
    (inputs,) = stream(case, 1)
    for k, each in enumerate(inputs):
        wrong = {n: x.numpy() for n, x in each.items()} if isinstance(each, dict) else each.numpy()
        with pytest.raises(TypeError, match="is a ndarray: give a tensor, such as"):
            module(*inputs[:k], wrong, *inputs[k + 1 :])

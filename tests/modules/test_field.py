"""Fields of 0 to 3 dimensions: phenomena, mathematics, contract."""

import copy
import io
import pickle

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.special import expit

from dntorch.cells.field import FieldState, field_rate
from dntorch.cells.kernels import SELECTIVE, Gauss, Global, Matrices, assemble
from dntorch.cells.readout import center_of_mass, peaks
from dntorch.modules.field import DNF
from dntorch.modules.node import NodeWTA

LINE, SHEET = (51,), (24, 30)
SHAPES = pytest.mark.parametrize("shape", [(), (9,), (5, 6), (3, 4, 5)], ids=str)
SELECTING = {LINE: SELECTIVE, SHEET: (Gauss(40.0, 2.0), Global(-0.5))}
MEMORY = {
    LINE: (Gauss(15.0, 3.0), Global(-0.3)),
    SHEET: (Gauss(40.0, 3.0), Gauss(-20.0, 6.0), Global(-0.1)),
}
DIMENSIONS = pytest.mark.parametrize("shape", [LINE, SHEET], ids=["1-D", "2-D"])


def bump(shape, amplitude, *at, sigma=3.0):
    axes = torch.meshgrid(*[torch.arange(float(n)) for n in shape], indexing="ij")
    return amplitude * torch.exp(
        -sum((x - p) ** 2 for x, p in zip(axes, at, strict=True)) / (2 * sigma**2)
    )


def part(shape, fraction):
    return [n * fraction // 4 for n in shape]


def hold(field, input, seconds=2.0):
    for _ in range(round(seconds / field.dt)):
        output = field(input)
    return output


def centers(output):
    """Where the peaks of one field are."""
    return peaks(output, 0.5, ("zero",) * output.dim()).center.tolist()


# Phenomena of field theory


@DIMENSIONS
def test_weak_input_is_passed_on_and_strong_input_is_detected(shape):
    field = DNF(shape, SELECTING[shape])
    weak, strong = bump(shape, 3.0, *part(shape, 2)), bump(shape, 6.0, *part(shape, 2))
    assert hold(field, weak).max() < 0.1
    torch.testing.assert_close(field.u, weak - 5, atol=0.05, rtol=0)
    assert len(centers(hold(field, strong))) == 1
    assert field.u.max() > 2 * (strong - 5).max()  # lifted by lateral excitation
    assert field.u.min() < -6  # and the rest suppressed


@DIMENSIONS
def test_a_peak_stabilises_itself_and_follows_history(shape):
    field = DNF(shape, SELECTING[shape], substeps=2)
    middle = bump(shape, 4.0, *part(shape, 2))
    assert not centers(hold(field, middle))
    hold(field, 2 * middle)
    assert len(centers(hold(field, middle))) == 1  # the very input that could not make one
    assert not centers(hold(field, 0 * middle))


@DIMENSIONS
def test_selection_between_two_inputs(shape):
    field = DNF(shape, SELECTING[shape], substeps=2)
    left, right = bump(shape, 7.0, *part(shape, 1)), bump(shape, 8.0, *part(shape, 3))
    (peak,) = centers(hold(field, left + right))
    assert peak == pytest.approx(part(shape, 3), abs=0.5)
    field.reset()
    hold(field, left)
    (peak,) = centers(hold(field, left + right))
    assert peak == pytest.approx(part(shape, 1), abs=0.5)  # the first one stays


@DIMENSIONS
def test_without_lateral_interaction_nothing_is_decided_or_kept(shape):
    field = DNF(shape, [Global(0.0)])
    both = bump(shape, 7.0, *part(shape, 1)) + bump(shape, 8.0, *part(shape, 3))
    assert len(centers(hold(field, both))) == 2
    assert not centers(hold(field, 0 * both))


@DIMENSIONS
def test_working_memory_outlives_its_input(shape):
    field = DNF(shape, MEMORY[shape], substeps=2)
    place = part(shape, 2)
    hold(field, bump(shape, 8.0, *place))
    (peak,) = centers(hold(field, torch.zeros(shape), 10.0))
    assert peak == pytest.approx(place, abs=0.1)
    assert not centers(hold(field, torch.full(shape, -10.0)))


def test_an_asymmetric_kernel_carries_the_peak_along():
    field = DNF(51, [Gauss(15.0, 3.0, shift=0.5), Global(-0.3)])
    start = center_of_mass(hold(field, bump(LINE, 8.0, 10), 1.0), "circular")
    there = center_of_mass(hold(field, torch.zeros(51), 1.0), "circular")
    assert 1 < (there - start) % 51 < 25


def test_zero_border_is_an_edge_and_circular_is_none():
    spill = {}
    for border in ("zero", "circular"):
        field = DNF(51, MEMORY[LINE], border=border)
        spill[border] = hold(field, bump(LINE, 8.0, 1, sigma=1.0))[-1]
    assert spill["zero"] < 0.01 and spill["circular"] > 0.9


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("dt", [1 / 32, 1 / 64])
def test_noise_has_the_same_variance_at_every_step_size(dt, substeps):
    field, generator = DNF((), [], tau=0.5, dt=dt, substeps=substeps), torch.Generator()
    field.resize(4000)
    for _ in range(round(4 / dt)):
        field(0.7 / dt**0.5 * torch.randn(4000, generator=generator))
    assert field.u.var() == pytest.approx(0.7**2 / (2 * 0.5), rel=0.12)


# Mathematics


def brute_force_rate(u, input, terms, inhibition, tau, h, steepness):
    """NumPy, circular, by rolling the output one offset after another."""
    output, axes = expit(steepness * u), tuple(range(u.ndim))
    total = -inhibition * output.sum() + np.zeros_like(u)
    for amplitude, sigma in terms:
        part = output
        for axis in axes:
            reach = int(np.ceil(5 * sigma))
            taps = {d: np.exp(-(d**2) / (2 * sigma**2)) for d in range(-reach, reach + 1)}
            part = sum(w * np.roll(part, d, axis) for d, w in taps.items()) / sum(taps.values())
        total = total + amplitude * part
    return (-u + h + input + total) / tau


@pytest.mark.parametrize("shape", [(25,), (13, 12), (6, 7, 5)], ids=str)
def test_rate_is_the_equation(shape):
    generator = np.random.default_rng(3)
    u, input = generator.normal(size=shape), generator.normal(size=shape)
    expected = brute_force_rate(u, input, [(9.0, 0.5), (-4.0, 0.4)], 0.2, 0.3, -2.0, 4.0)
    kernel = Gauss(9.0, 0.5), Gauss(-4.0, 0.4), Global(-0.2)
    u, input = torch.from_numpy(u), torch.from_numpy(input)
    arguments = *assemble(kernel, list(shape), "circular"), 0.3, -2.0, "logistic", 4.0, 0.0
    actual = field_rate(input, FieldState(u), *arguments).u
    torch.testing.assert_close(actual, torch.from_numpy(expected))


@pytest.mark.parametrize(
    ("integrator", "order", "steps"), [("euler", 1, (64, 96, 128)), ("heun", 2, (24, 32, 48))]
)
@pytest.mark.parametrize("seconds", [0.25, 0.5, 1.0])
def test_order_of_convergence(integrator, order, steps, seconds):
    n, terms, input = 31, [(15.0, 2.0)], bump((31,), 7.0, 15).double().numpy()

    def rate(_, u):
        return brute_force_rate(u, input, terms, 0.3, 0.1, -5.0, 4.0)

    exact = solve_ivp(rate, (0, seconds), np.full(n, -5.0), rtol=1e-11, atol=1e-11).y[:, -1]
    kernel, errors = [Gauss(15.0, 2.0), Global(-0.3)], []
    for k in steps:
        field = DNF(
            n, kernel, dt=seconds, substeps=round(k * seconds / 0.25),
            integrator=integrator, dtype=torch.float64,
        )  # fmt: skip
        field(torch.from_numpy(input))
        errors.append(np.abs(field.u.numpy() - exact).max())
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(order, abs=0.25)


@SHAPES
def test_a_step_leaves_a_fixed_point_alone(shape):
    """For any state there is an input that makes it a fixed point: minus the rate of none."""
    field = DNF(shape, [Gauss(6.0, 0.5), Global(-0.2)], integrator="heun", dtype=torch.float64)
    u = torch.randn(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    kernels, everywhere = assemble([Gauss(6.0, 0.5), Global(-0.2)], list(shape), "circular")
    arguments = kernels, everywhere, 0.1, -5.0, "logistic", 4.0, 0.0
    input = -0.1 * field_rate(torch.zeros_like(u), FieldState(u), *arguments).u
    assert field_rate(input, FieldState(u), *arguments).u.abs().max() < 1e-12
    torch.testing.assert_close(field.step(input, FieldState(u))[1].u, u)


def test_no_dimension_is_a_node_with_self_excitation():
    field = DNF((), [Global(10.0)], tau=0.3, kind="abs", steepness=100.0)
    node = NodeWTA(1, tau=0.3, excitation=10.0, steepness=100.0)
    for input in 6 * torch.rand(100, generator=torch.Generator().manual_seed(2)):
        torch.testing.assert_close(field(input), node(input[None])[0])


def test_a_kernel_can_be_learned():
    teacher, student = (
        DNF(9, [Gauss(6.0, 1.0)], h=-0.5),
        DNF(9, [Matrices((torch.eye(9),))], h=-0.5),
    )
    student.kernel_0 = torch.nn.Parameter(student.kernel_0)
    optimizer = torch.optim.Adam(student.parameters(), lr=0.2)
    u = 2 * torch.rand(64, 9, generator=torch.Generator().manual_seed(0)) - 1
    for _ in range(100):
        ahead = [m.step(torch.zeros(9), FieldState(u))[1].u for m in (teacher, student)]
        loss = (ahead[0] - ahead[1]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    torch.testing.assert_close(student.kernel_0.detach(), teacher.kernel_0, atol=0.1, rtol=0)
    assert list(student.state_dict()) == ["kernel_0"]


# Contract


def make(shape, **options):
    field = DNF(shape, [Gauss(9.0, 0.8), Gauss(-3.0, 1.2), Global(-0.2)], **options)
    input = 8 * torch.rand(shape, generator=torch.Generator().manual_seed(4))
    return field, input.to(field.u.dtype)


@SHAPES
def test_forward_is_step_and_memory(shape):
    field, input = make(shape)
    output, state = field.step(input, field.initial([]))
    assert torch.equal(field(input), output) and torch.equal(field.state.u, state.u)
    snapshot = field.state
    field(input)
    assert not torch.equal(snapshot.u, field.u)
    field.reset()
    assert (field.u == field.h).all() and field.u.shape == shape


@SHAPES
def test_rows_of_a_batch_are_independent(shape):
    field, input = make(shape, integrator="heun", substeps=2)
    inputs = torch.stack([input, 0 * input, 2 * input])
    alone = [hold(make(shape, integrator="heun", substeps=2)[0], row, 0.5) for row in inputs]
    torch.testing.assert_close(hold(field.resize(3), inputs, 0.5), torch.stack(alone))
    mapped = torch.vmap(field.step)(inputs, field.state)[0]
    torch.testing.assert_close(mapped, field(inputs))


@SHAPES
@pytest.mark.parametrize("integrator", ["euler", "heun"])
def test_gradients_agree_with_differences(shape, integrator):
    field, input = make(shape, integrator=integrator, substeps=2, dtype=torch.float64)
    u = torch.randn(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    inputs = input.requires_grad_(), u.requires_grad_()
    assert torch.autograd.gradcheck(lambda i, u: field.step(i, FieldState(u))[1].u, inputs)


@SHAPES
def test_copies_are_independent_and_checkpoints_hold_no_activation(shape):
    field, input = make(shape)
    field(input.requires_grad_())
    for twin in (copy.deepcopy(field), pickle.loads(pickle.dumps(field))):
        assert torch.equal(twin(input), field.step(input, field.state)[0])
        assert not torch.equal(twin.u, field.u)
    assert not field.state_dict()


@SHAPES
def test_float64_at_construction_has_exact_kernels_and_double_moves_all(shape):
    exact, input = make(shape, dtype=torch.float64)
    moved = make(shape)[0].double()
    assert exact(input).dtype == moved(input).dtype == torch.float64
    torch.testing.assert_close(moved.u, exact.u, atol=1e-5, rtol=0)
    matrices, _ = assemble(
        [Gauss(9.0, 0.8), Gauss(-3.0, 1.2), Global(-0.2)], list(shape), "circular"
    )
    for axis, matrix in enumerate(matrices):
        assert torch.equal(getattr(exact, f"kernel_{axis}"), matrix)


@SHAPES
@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
def test_scripted_and_exported_fields_agree_with_eager(shape):
    field, input = make(shape, integrator="heun", substeps=2)
    scripted = torch.jit.script(copy.deepcopy(field))
    torch.jit.save(scripted, file := io.BytesIO())
    file.seek(0)
    loaded = torch.jit.load(file)
    exported = torch.export.export(copy.deepcopy(field), (input,)).module()
    for _ in range(20):
        expected = field(input)
        for twin in (scripted, loaded, exported):
            torch.testing.assert_close(twin(input), expected)
    scripted.reset()
    assert (scripted.u == field.h).all()


class Pure(torch.nn.Module):
    def __init__(self, field):
        super().__init__()
        self.field = field

    def forward(self, input, u):
        output, state = self.field.step(input, FieldState(u))
        return output, state.u


@SHAPES
def test_the_pure_step_exports_with_a_dynamic_batch(shape):
    field, input = make(shape)
    inputs = torch.stack([input] * 3)
    batch = {0: torch.export.Dim("batch")}
    program = torch.export.export(
        Pure(field), (inputs, field.initial([3]).u), dynamic_shapes=(batch, batch)
    )
    more = torch.cat([inputs, -inputs])
    torch.testing.assert_close(
        program.module()(more, field.initial([6]).u)[0], field.step(more, field.initial([6]))[0]
    )


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
@pytest.mark.parametrize(("shape", "integrator"), [((9,), "euler"), ((5, 6), "heun")])
def test_compiled_fields_agree_with_eager(shape, integrator):
    field, input = make(shape, integrator=integrator)
    compiled = torch.compile(copy.deepcopy(field), fullgraph=True)
    for _ in range(20):
        torch.testing.assert_close(compiled(input), field(input))


@pytest.mark.parametrize("kind", ["abs", "logistic", "heaviside"])
def test_every_sigmoid_makes_a_peak(kind):
    assert len(centers(hold(DNF(51, kind=kind), bump(LINE, 8.0, 25)))) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shape": (2, 2, 2, 2)}, r"shape=\(2, 2, 2, 2\).* 0 to 3 axes"),
        ({"shape": 0}, "shape=0.* at least one"),
        ({"tau": 0.01}, "dt=0.03125 is longer than tau=0.01.* sub-steps"),
        ({"tau": -1.0}, "tau=-1.0 must be positive"),
        ({"dt": 0.0}, "dt=0.0 must be positive"),
        ({"substeps": 0}, "substeps=0"),
        ({"integrator": "rk4"}, "integrator='rk4'.*'euler' or 'heun'"),
        ({"kind": "relu"}, "relu.*'logistic'"),
        ({"border": "mirror"}, "border='mirror'.*'circular' or 'zero'"),
    ],
)
def test_wrong_arguments_name_argument_value_and_remedy(options, message):
    with pytest.raises(ValueError, match=message):
        DNF(**{"shape": 9, **options})


def test_sub_steps_allow_a_longer_control_step():
    assert DNF(9, tau=0.01, substeps=4).dt == 1 / 32


@pytest.mark.parametrize(("shape", "given"), [(9, (8,)), (9, ()), ((5, 6), (6,)), ((5, 6), (6, 5))])
def test_input_of_a_wrong_shape_says_what_fits(shape, given):
    message = r"input of shape \[.*\] does not end in \[.*\] after its batch: reshape"
    with pytest.raises(ValueError, match=message):
        DNF(shape)(torch.zeros(given))


def test_an_unknown_batch_says_how_to_allocate_it():
    with pytest.raises(ValueError, match=r"\[4, 9\] does not fit .* \[9\]: call resize"):
        DNF(9)(torch.zeros(4, 9))


@pytest.mark.parametrize("substeps", [1, 2, 5])
def test_euler_advances_by_dt_whatever_the_substeps(substeps):
    """A composite that calls it runs at full speed: 3 (1 - (1 - dt / 2 tau)^2) = .864 for two."""
    field = DNF((), (), substeps=substeps)
    ahead = field.euler(torch.tensor(3.0), field.initial([]))
    moved = float(ahead.u) - field.h
    assert moved == pytest.approx(3 * (1 - (1 - field.dt / substeps / field.tau) ** substeps))
    assert torch.equal(field.step(torch.tensor(3.0), field.initial([]))[1].u, ahead.u)

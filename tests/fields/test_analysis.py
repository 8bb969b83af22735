"""Reading fields and nodes: fixed points, peaks, rate code and space code."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.autograd import gradcheck

from dntorch import DNF, Gauss, Global, NodeWTA, fixed_points, peaks, rate_code, space_code
from dntorch.analysis import equation
from dntorch.cells.readout import center_of_mass

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def node(kind="logistic", gain=6.0, **options):
    return DNF((), [Global(gain)], kind=kind, **options)


# Fixed points


@pytest.mark.parametrize("kind", ["logistic", "abs", "heaviside"])
def test_a_bistable_node_has_three_fixed_points_and_others_one(kind):
    one = node(kind)
    for input, stable in [(-2.0, [True]), (2.0, [True, False, True]), (6.0, [True])]:
        found = fixed_points(one, input)
        assert [point.stable for point in found] == stable
        assert [point.u for point in found] == sorted(point.u for point in found)
    assert found[0].u > 0


NUMBERS = st.tuples(
    st.sampled_from(["logistic", "abs"]),
    st.floats(-12, 12),  # gain
    st.floats(-3, 12),  # input
    st.floats(0.5, 60),  # steepness
    st.floats(-2, 2),  # threshold
)


@given(NUMBERS)
def test_none_is_missed_and_none_is_made_up(numbers):
    """Against all changes of sign on a fine grid, which finds no more and no others."""
    kind, gain, input, steepness, threshold = numbers
    one = node(kind, gain, steepness=steepness, threshold=threshold)
    found = fixed_points(one, input)
    curve = equation(one)
    u = torch.linspace(-30, 30, 120_001, dtype=torch.float64)
    signs = curve.rate(input, u).sign()
    changes = (signs[:-1] * signs[1:] <= 0).nonzero().squeeze(-1)
    assert len(found) >= 1
    for k in changes.tolist():
        assert min(abs(point.u - float(u[k])) for point in found) < 1e-3
    for point in found:
        here = torch.tensor(point.u, dtype=torch.float64)
        size = 1 + abs(gain) * steepness
        assert abs(curve.rate(input, here).item() * curve.tau) < 1e-12 * size
    stable = [point.stable for point in found]
    assert stable in ([True], [True, False, True], [True, False], [False, True])


@given(NUMBERS)
def test_a_step_of_the_node_stays_on_a_fixed_point(numbers):
    kind, gain, input, steepness, threshold = numbers
    one = DNF((), [Global(gain)], kind=kind, steepness=steepness, threshold=threshold,
              dtype=torch.float64)  # fmt: skip
    for point in fixed_points(one, input):
        state = one.initial([])._replace(u=torch.tensor(point.u, dtype=torch.float64))
        _, after = one.step(torch.tensor(input, dtype=torch.float64), state)
        assert after.u.item() == pytest.approx(point.u, abs=1e-11 * (1 + abs(gain) * steepness))


@pytest.mark.parametrize("kind", ["logistic", "abs", "heaviside"])
def test_the_node_itself_goes_where_it_is_stable_and_leaves_where_it_is_not(kind):
    one = node(kind, dtype=torch.float64)
    low, middle, high = fixed_points(one, 2.2)
    for start, end in [(low.u - 3, low), (middle.u - 0.01, low), (middle.u + 0.01, high),
                       (high.u + 3, high)]:  # fmt: skip
        one.state = one.initial([])._replace(u=torch.tensor(start, dtype=torch.float64))
        for _ in range(400):
            one(torch.tensor(2.2, dtype=torch.float64))
        assert one.u.item() == pytest.approx(end.u, abs=1e-9)


def test_tangents_of_both_sides_in_closed_form():
    """At a turn c f' = 1: for the logistic p = (1 ± sqrt(1 - 4 / c b)) / 2."""
    gain, steepness = 6.0, 4.0
    for side in (-1, 1):
        rate = (1 + side * math.sqrt(1 - 4 / (gain * steepness))) / 2
        turn = math.log(rate / (1 - rate)) / steepness
        input = turn + 5.0 - gain * rate  # where rate of change and slope are zero
        found = fixed_points(node(gain=gain, steepness=steepness), input)
        assert [point.stable for point in found] == ([False, True] if side < 0 else [True, False])
        tangent = found[0] if side < 0 else found[1]
        assert tangent.u == pytest.approx(turn, abs=1e-12)
        counts = [
            len(fixed_points(node(gain=gain, steepness=steepness), input + shift))
            for shift in (-1e-6, 1e-6)
        ]
        assert sorted(counts) == [1, 3]


def test_a_jump_counts_as_the_limit_of_steep_sigmoids():
    steep = fixed_points(node("abs", steepness=1e7), 2.0)
    jump = fixed_points(node("heaviside"), 2.0)
    assert [u for u, _ in jump] == [-3.0, 0.0, 3.0]
    assert [u for u, _ in steep] == pytest.approx([-3.0, 0.0, 3.0], abs=1e-5)
    assert [s for _, s in steep] == [s for _, s in jump] == [True, False, True]
    back = fixed_points(node("heaviside", -6.0), 8.0)  # driven to the threshold from both sides
    assert back == [(0.0, True)]
    assert fixed_points(node("abs", -6.0, steepness=1e7), 8.0) == [
        (pytest.approx(0, abs=1e-5), True)
    ]
    assert fixed_points(node("heaviside"), 5.0) == [(0.0, False), (6.0, True)]  # tangent
    assert fixed_points(node("heaviside"), -1.0) == [(-6.0, True), (0.0, False)]
    assert fixed_points(node("heaviside", 0.0), 5.0) == [(0.0, True)]


def test_many_inputs_draw_the_hysteresis():
    one = NodeWTA(1, excitation=6.0, steepness=4.0)
    inputs = torch.linspace(-2, 6, 161)
    branches = fixed_points(one, inputs)
    assert branches == [fixed_points(one, s.item()) for s in inputs]
    three = inputs[[len(points) == 3 for points in branches]]
    half = (math.sqrt(6.0 * 4 / 2) - 1) / 4  # where the curve of AbsSigmoid turns
    rate = 0.5 * (1 + 4 * half / (1 + 4 * half))
    first, last = half + 5 - 6 * rate, -half + 5 - 6 * (1 - rate)  # closed form
    assert three.min() == pytest.approx(first, abs=0.05)
    assert three.max() == pytest.approx(last, abs=0.05)


def test_a_floor_is_the_lowest_fixed_point_where_the_rate_presses_on_it():
    free, floored = NodeWTA(1), NodeWTA(1, floor=-6.0)
    assert fixed_points(floored, 0.0) == fixed_points(free, 0.0)
    (low, *rest), (_, *same) = fixed_points(floored, -4.0), fixed_points(free, -4.0)
    assert low == (-6.0, True) and rest == same


def test_parameters_of_one_member_and_refusals():
    many = DNF((), [Global(6.0)], h=torch.tensor([-5.0, -4.0]))
    with pytest.raises(ValueError, match=r"h has 2 numbers: give one member, node.select\(k\)"):
        fixed_points(many, 0.0)
    low = [fixed_points(many.select(k), 0.0)[0].u for k in range(2)]
    assert low == pytest.approx([-5, -4], abs=1e-5)
    for wrong, words in [(DNF(5), "shape=[5] is more than one"), (NodeWTA(3), "n=3 is more than")]:
        with pytest.raises(ValueError, match=words.replace("[", r"\[")):
            fixed_points(wrong, 0.0)
    with pytest.raises(TypeError, match="node is a Linear: give DNF"):
        fixed_points(torch.nn.Linear(1, 1), 0.0)
    for input, words in [
        (math.nan, "input has 1 NaN"),
        (math.inf, "input=inf is not finite"),
        (torch.zeros(2, 2), r"input of shape \[2, 2\] has too many"),
    ]:
        with pytest.raises(ValueError, match=words):
            fixed_points(node(), input)


# Centre of mass


def test_center_of_mass_on_both_kinds_of_axis():
    site = torch.arange(51.0)
    output = torch.exp(-((site[:, None] - torch.tensor([20.0, 30.5])) ** 2) / 8).T
    for border in ("zero", "circular"):
        torch.testing.assert_close(center_of_mass(output, border), torch.tensor([20.0, 30.5]))
    across = (torch.roll(output, 25, -1)).double()
    torch.testing.assert_close(
        center_of_mass(across, "circular"), torch.tensor([45.0, 4.5]).double(), atol=1e-3, rtol=0
    )
    assert center_of_mass(torch.zeros(2, 5), "zero").isnan().all()
    assert center_of_mass(torch.zeros(2, 5), "circular").isnan().all()
    assert center_of_mass(torch.ones(2, 5), "circular").isnan().all()  # no direction


# Peaks


def one_by_one(u, threshold, borders):
    """Peaks of one field, by a plain search that shares nothing with the library."""
    on, found = {tuple(site) for site in (u > threshold).nonzero().tolist()}, []
    while on:
        region, front = set(), [max(on)]
        while front:
            site = front.pop()
            if site not in on:
                continue
            on.remove(site)
            region.add(site)
            for axis, n in enumerate(u.shape):
                for way in (-1, 1):
                    k = site[axis] + way
                    if borders[axis] == "circular" or 0 <= k < n:
                        front.append((*site[:axis], k % n, *site[axis + 1 :]))
        mass = sum(u[site].item() - threshold for site in region)
        width = [len({site[axis] for site in region}) for axis in range(u.dim())]
        found.append((max(region), mass, width))
    return [(mass, width) for _, mass, width in sorted(found)]


FIELDS = st.tuples(
    st.lists(st.integers(1, 9), min_size=1, max_size=3),
    st.lists(st.sampled_from(["circular", "zero"]), min_size=3, max_size=3),
    st.integers(0, 10_000),
    st.floats(-1, 1.5),
)


def test_a_semilinear_node_has_an_upper_fixed_point_that_is_stable_with_a_small_gain():
    def semilinear(gain):
        return node("semilinear", gain, steepness=2.0, threshold=1.0)

    assert fixed_points(semilinear(0.25), 4.0) == [(-1.0, True)]
    assert fixed_points(semilinear(0.25), 8.0) == [(5.0, True)]  # u = 3 + (u - 1) / 2
    assert fixed_points(semilinear(1.0), 4.0) == [(-1.0, True), (3.0, False)]
    assert fixed_points(semilinear(1.0), 8.0) == []  # grows for ever
    assert fixed_points(semilinear(1.0), 6.0) == [(1.0, False)]
    assert fixed_points(semilinear(-1.0), 6.0) == [(1.0, True)]


@given(FIELDS)
def test_peaks_are_those_of_a_plain_search_and_rows_are_single_runs(field):
    shape, borders, seed, threshold = field
    borders = tuple(borders[: len(shape)])
    u = torch.randn(2, 2, *shape, generator=torch.Generator().manual_seed(seed)).double()
    whole = peaks(u, threshold, borders)
    for i in range(2):
        for j in range(2):
            alone, n = peaks(u[i, j], threshold, borders), int(whole.count[i, j])
            slow = one_by_one(u[i, j], threshold, borders)
            assert alone.width.tolist() == [width for _, width in slow]
            assert alone.mass.tolist() == pytest.approx([mass for mass, _ in slow])
            for batched, single in zip(whole[1:], alone[1:], strict=True):
                torch.testing.assert_close(
                    batched[i, j, :n], single, rtol=1e-12, atol=1e-12, equal_nan=True
                )
            assert whole.center[i, j, n:].isnan().all()
            assert not whole.mass[i, j, n:].any() and not whole.width[i, j, n:].any()


@given(st.integers(0, 10_000), st.tuples(st.integers(-9, 9), st.integers(-12, 12)))
def test_peaks_move_with_the_field_around_a_torus(seed, shift):
    draw = torch.Generator().manual_seed(seed)
    places = torch.rand(3, 2, generator=draw).double() * torch.tensor([20.0, 24.0])
    borders = ("circular", "circular")
    u = space_code(places, (20, 24), 0.0, (20.0, 24.0), 1.7, borders).sum(0) - 0.5
    found, moved = peaks(u, 0.0, borders), peaks(u.roll(shift, (0, 1)), 0.0, borders)
    assert int(found.count) == int(moved.count) >= 1
    sizes = torch.tensor([20.0, 24.0])
    away = found.center[:, None] + torch.tensor(shift) - moved.center
    away = ((away + sizes / 2) % sizes - sizes / 2).abs().amax(-1)
    match = away.argmin(-1)
    assert away.amin(-1).max() < 1e-9 and sorted(match.tolist()) == list(range(len(match)))
    torch.testing.assert_close(found.mass, moved.mass[match])
    torch.testing.assert_close(found.width, moved.width[match])


def test_peaks_over_the_border_and_around_corners():
    output = torch.zeros(10, 12)
    output[0, 3:6] = output[9, 3:6] = output[4:7, 8] = 1.0
    found = peaks(output, 0.5, ("circular", "zero"))
    torch.testing.assert_close(found.center, torch.tensor([[5.0, 8.0], [9.5, 4.0]]))
    assert found.width.tolist() == [[3, 1], [2, 3]] and found.mass.tolist() == [1.5, 3.0]
    assert peaks(output, 0.5, ("zero", "zero")).count == 3
    assert peaks(output, 0.5, "zero").count.tolist() == [1, 0, 0, 0, 1, 1, 1, 0, 0, 1]  # ten lines
    none = peaks(0 * output, 0.5, ("zero", "zero"))
    assert none.count == 0 and none.center.shape == (0, 2) and none.mass.shape == (0,)
    spiral = torch.tensor([[1, 1, 1, 1], [0, 0, 0, 1], [1, 1, 0, 1], [1, 0, 0, 1], [1, 1, 1, 1.0]])
    assert peaks(spiral, 0.5, ("zero", "zero")).count == 1
    ring = peaks(torch.ones(4, 9), 0.5, ("zero", "circular"))
    assert ring.center[0, 0] == 1.5 and ring.center[0, 1].isnan()  # no place on the ring


@DTYPES
def test_peaks_agree_with_an_independent_labelling(dtype):
    ndimage = pytest.importorskip("scipy.ndimage")
    u = torch.randn(40, 50, generator=torch.Generator().manual_seed(3)).to(dtype)
    u = u + u.roll(1, 0) + u.roll(1, 1)
    found = peaks(u, 1.0, ("zero", "zero"))
    labels, count = ndimage.label((u > 1.0).numpy())
    weight = (u - 1.0).clamp_min(0).double().numpy()
    centers = ndimage.center_of_mass(weight, labels, range(1, count + 1))
    assert int(found.count) == count > 50 and found.mass.dtype == dtype
    away = torch.cdist(found.center.double(), torch.tensor(centers))
    assert away.amin(0).max() < 1e-4 and away.amin(1).max() < 1e-4
    assert len(set(away.argmin(0).tolist())) == count


def test_centre_and_mass_are_differentiable_and_continuous():
    u = torch.tensor([-1.0, 0.4, 2.0, 0.7, -2.0, -3.0, 1.0, -1.0], dtype=torch.float64)
    gradcheck(lambda u: peaks(u, 0.0, "zero")[1:3], u.clone().requires_grad_())
    gradcheck(lambda u: peaks(u, 0.0, "circular")[1:3], u.clone().requires_grad_())
    two = torch.stack((u, -u.abs())).requires_grad_()  # the padding has no gradient, not NaN
    peaks(two).center.nansum().backward()
    assert two.grad.isfinite().all() and not two.grad[1].any() and two.grad[0].any()
    before = peaks(u.detach().index_fill(0, torch.tensor(4), -1e-9))
    after = peaks(u.detach().index_fill(0, torch.tensor(4), 1e-9))
    torch.testing.assert_close(before.center[0], after.center[0], atol=1e-7, rtol=0)


def test_a_field_that_selects_has_one_peak_where_its_strongest_input_is():
    field = DNF(60).resize(4)
    place = torch.tensor([3.0, 21.0, 40.0, 58.5])
    two = space_code(place, 60, 0.0, 60.0, 3.0, amplitude=8.0)
    two = two + space_code(place + 30, 60, 0.0, 60.0, 3.0, amplitude=7.0)
    for _ in range(64):
        field(two)
    found = peaks(field.u)
    assert found.count.tolist() == [1] * 4
    torch.testing.assert_close(found.center.flatten(), place, atol=0.05, rtol=0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((torch.tensor([0.0, math.nan]),), "u has 1 NaN of 2 numbers"),
        ((torch.zeros(5), math.nan), "threshold=nan is not finite"),
        ((torch.zeros(5), 0.0, "round"), "border='round' is unknown"),
        ((torch.zeros(5), 0.0, ()), r"border=\(\) has no axis"),
        ((torch.zeros(5), 0.0, ("zero", "zero")), r"u of shape \[5\] is no field of 2 axes"),
        ((torch.zeros(3, 0),), r"u of shape \[3, 0\] is no field"),
    ],
)
def test_peaks_refuse_in_one_sentence(arguments, words):
    with pytest.raises(ValueError, match=words):
        peaks(*arguments)


def test_peaks_take_tensors_of_floats_and_empty_batches():
    with pytest.raises(TypeError, match="u is a list: give a tensor"):
        peaks([1.0, 2.0])
    with pytest.raises(TypeError, match=r"u of dtype torch.bool has no floats: give u.float\(\)"):
        peaks(torch.zeros(5) > 0)
    found = peaks(torch.zeros(0, 3, 5))
    assert found.count.shape == (0, 3) and found.center.shape == (0, 3, 0, 1)


# Codes


@DTYPES
@given(st.floats(0, 359.99), st.integers(20, 200), st.floats(1.0, 2.0))
def test_codes_invert_each_other_on_a_ring(dtype, value, n, sigma):
    given_value = torch.tensor(value, dtype=dtype)
    back = rate_code(space_code(given_value, n, 0.0, 360.0, sigma), 0.0, 360.0)
    away = (back - given_value + 180) % 360 - 180
    bound = 1e-5 * 360 / n if dtype == torch.float64 else 1e-6 * 360
    assert back.dtype == dtype and abs(away.item()) < bound


@pytest.mark.parametrize("sigma", [1.0, 3.0, 5.0])
def test_codes_invert_each_other_between_edges_and_the_edge_draws_inwards(sigma):
    n = 101
    spread = torch.linspace(5 * sigma, n - 1 - 5 * sigma, 37).double() / 50 - 1
    back = rate_code(space_code(spread, n, -1.0, 1.0, sigma, "zero"), -1.0, 1.0, "zero")
    assert (back - spread).abs().max() < 1e-5 * 2 / (n - 1)
    edge = space_code(torch.tensor(1.0).double(), n, -1.0, 1.0, sigma, "zero")
    inwards = (1 - rate_code(edge, -1.0, 1.0, "zero")) * 50
    assert 0.4 * sigma < inwards < 0.8 * sigma


def test_the_worst_error_is_the_one_that_the_docstring_states():
    value = torch.linspace(0, 1, 2001).double()[:-1]

    def worst(n, sigma):
        back = rate_code(space_code(value, n, 0.0, 1.0, sigma), 0.0, 1.0)
        return (((back - value + 0.5) % 1 - 0.5) * n).abs().max().item()

    assert worst(50, 1.0) < 1e-5 and worst(50, 5.0) < 1e-5 and worst(20, 2.0) < 1e-5
    assert 1e-2 < worst(50, 0.5) < 3e-2


@given(st.integers(0, 10_000), st.integers(-30, 30))
def test_codes_move_with_the_field(seed, shift):
    output = torch.rand(3, 30, generator=torch.Generator().manual_seed(seed)).double()
    moved = rate_code(output.roll(shift, -1), 0.0, 30.0, threshold=0.0)
    away = (moved - rate_code(output, 0.0, 30.0, threshold=0.0) - shift + 15) % 30 - 15
    assert away.abs().max() < 1e-9
    value = 30 * torch.rand(3, generator=torch.Generator().manual_seed(seed)).double()
    bump = space_code(value, 30, 0.0, 30.0, 2.0)
    torch.testing.assert_close(space_code(value + shift, 30, 0.0, 30.0, 2.0), bump.roll(shift, -1))


@DTYPES
def test_codes_of_sheets_and_batches(dtype):
    low, high, borders = (0.0, -1.0), (360.0, 1.0), ("circular", "zero")
    value = torch.tensor([[[350.0, 0.0], [90.0, 0.3]], [[0.0, -0.2], [181.0, 0.1]]], dtype=dtype)
    sheet = space_code(value, (72, 41), low, high, (2.0, 2.5), borders)
    assert sheet.shape == (2, 2, 72, 41) and sheet.dtype == dtype
    back = rate_code(sheet, low, high, borders)
    away = (back - value + 180) % 360 - 180
    assert away.abs().max() < 1e-3
    for i in range(2):
        for j in range(2):
            single = space_code(value[i, j], (72, 41), low, high, (2.0, 2.5), borders)
            assert torch.equal(single, sheet[i, j])
            torch.testing.assert_close(rate_code(sheet[i, j], low, high, borders), back[i, j])
    block = space_code(value[..., [0, 1, 1]], (5, 6, 7), -1.0, 1.0, 1.0, "zero")
    lines = [
        space_code(value[..., k], n, -1.0, 1.0, 1.0, "zero") for k, n in ((0, 5), (1, 6), (1, 7))
    ]
    expected = torch.einsum("...a,...b,...c->...abc", *lines)
    torch.testing.assert_close(block, expected)
    assert space_code(value[..., :1], (9,), 0.0, 1.0, 1.0).shape == (2, 2, 9)
    assert rate_code(torch.ones(4, 9), 0.0, 1.0, ("zero",)).shape == (4, 1)


def test_a_silent_field_says_so():
    field = DNF(51)
    silent = field(torch.zeros(51))  # at rest its outputs are tiny, but not zero
    assert silent.max() > 0 and rate_code(silent, 0.0, 360.0) == 180
    assert rate_code(silent, -2.0, 1.0, "zero") == -0.5
    assert rate_code(silent, -2.0, 1.0, "zero", silent=7.0) == 7
    assert rate_code(silent, 0.0, 1.0, silent=math.nan).isnan()
    assert rate_code(torch.ones(51), 0.0, 1.0) == 0.5  # on all around: no direction
    assert rate_code(torch.tensor([1.0, math.nan, 0.0]), 0.0, 1.0).isnan()  # not hidden
    rows = torch.stack((torch.zeros(51), torch.ones(51).cumsum(0) / 51)).double().requires_grad_()
    rate_code(rows, 0.0, 1.0).sum().backward()
    assert rows.grad.isfinite().all() and not rows.grad[0].any() and rows.grad[1].any()


def test_codes_are_differentiable_compile_and_vmap():
    value = torch.tensor([0.12, 0.77]).double().requires_grad_()
    gradcheck(lambda v: space_code(v, 20, 0.0, 1.0, 1.5), value)
    gradcheck(lambda v: space_code(v, (6, 7), 0.0, 1.0, 1.5, ("zero", "circular")), value)
    output = torch.rand(2, 5, 6, generator=torch.Generator().manual_seed(0)).double()
    output.requires_grad_()
    gradcheck(lambda f: rate_code(f, 0.0, 1.0, ("circular", "zero")), output)
    gradcheck(lambda f: rate_code(f, 0.0, 1.0, ("zero", "circular")), output)
    there_and_back = lambda v: rate_code(space_code(v, 20, 0.0, 1.0, 1.5), 0.0, 1.0)  # noqa: E731
    torch.testing.assert_close(torch.vmap(there_and_back)(value), there_and_back(value))
    compiled = torch.compile(there_and_back, fullgraph=True, backend="eager")
    torch.testing.assert_close(compiled(value), there_and_back(value))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda v: space_code(v, 9, 1.0, 1.0, 1.0), r"low=1.0 is not below high=1.0"),
        (lambda v: space_code(v, 9, 0.0, math.inf, 1.0), "high=inf is not finite"),
        (
            lambda v: space_code(v, 9, 0.0, 1.0, -2.0),
            "sigma=-2.0 must be positive: give a width in sites",
        ),
        (
            lambda v: space_code(v, 0, 0.0, 1.0, 1.0),
            "shape=0: give a number of sites, at least one",
        ),
        (lambda v: space_code(v, 1, 0.0, 1.0, 1.0, "zero"), "shape=1: a zero axis of one site"),
        (lambda v: space_code(v, (9, 9), 0.0, 1.0, 1.0), r"value of shape \[\] does not end in"),
        (lambda v: space_code(v * math.nan, 9, 0.0, 1.0, 1.0), "value has 1 NaN"),
        (lambda v: space_code(v, 9, 0.0, 1.0, 1.0, ("zero", "zero")), "has 2 words for 1 axes"),
        (lambda v: space_code(v, 9, (0.0, 1.0), 1.0, 1.0), "low=.* has 2 entries for 1 axes"),
        (lambda v: space_code(v, 9, 0.0, 1.0, 1.0, amplitude=math.nan), "amplitude=nan"),
        (lambda v: rate_code(v, 0.0, 1.0), r"output of shape \[\] is no field of 1 axes"),
        (lambda v: rate_code(v + torch.ones(5), 2.0, 1.0), "low=2.0 is not below high=1.0"),
        (lambda v: rate_code(v - torch.ones(5), 0.0, 1.0), "output has 5 numbers below 0: give f"),
        (lambda v: rate_code(v + torch.ones(5), 0.0, 1.0, "cyclic"), "border='cyclic' is unknown"),
    ],
)
def test_codes_refuse_in_one_sentence(call, words):
    with pytest.raises(ValueError, match=words):
        call(torch.tensor(0.5))
    with pytest.raises(TypeError, match="value is a float: give a tensor"):
        space_code(0.5, 9, 0.0, 1.0, 1.0)


def test_a_kernel_of_a_node_may_have_many_terms():
    """What is a Gaussian on a line is a plain factor in a node."""
    assert fixed_points(DNF((), [Gauss(7.0, 1.0), Global(-1.0)]), 2.0) == fixed_points(node(), 2.0)

"""What each class of elements computes, against plain loops over its definition."""

import math

import pytest
import torch
from cosivina_models import element, field, pattern, write

from dntorch.cosivina import load, noise

LINE = [0.0, 1.0, 4.0, 2.0, 7.0, 1.0, 3.0]
PLANE = [[1.0, 2.0, 5.0], [3.0, 0.0, 4.0]]
SQUARE = [[1.0, 2.0, 5.0], [3.0, 0.0, 4.0], [7.0, 6.0, 8.0]]


def shown(folder, size, *elements, read="it", component="output", inputs=None):
    """What an element gives: a field without memory takes it over in one step."""
    path = write(folder, *elements, field("u", size, (read, component), tau=1, h=0))
    model = load(path, torch.float64)
    _, state = model.step(inputs or {}, model.initial([]))
    return state["u"]


def close(x, y):
    torch.testing.assert_close(x, torch.as_tensor(y, dtype=torch.float64), rtol=0, atol=1e-12)


def bell(d, sigma):
    return float(d == 0) if sigma == 0 else math.exp(-0.5 * d**2 / sigma**2)


def taps(n, terms, reach, circular, normalized, shift=0):
    """Offset -> weight, of amplitudes and widths."""
    low, high = (-((n - 1) // 2), n // 2) if circular else (1 - n, n - 1)
    offsets = [d for d in range(low, high + 1) if abs(d) <= reach]
    kernel = dict.fromkeys(offsets, 0.0)
    for amplitude, sigma in terms:
        raw = {d: bell(d - shift, sigma) for d in offsets}
        total = sum(raw.values()) if normalized else 1.0
        for d in offsets:
            kernel[d] += amplitude * raw[d] / total
    return kernel


def convolved(line, kernel, circular):
    n, out = len(line), [0.0] * len(line)
    for x in range(n):
        for d, weight in kernel.items():
            if circular or 0 <= x - d < n:
                out[x] += weight * line[(x - d) % n]
    return out


@pytest.mark.parametrize("circular", [1, 0])
@pytest.mark.parametrize("normalized", [1, 0])
@pytest.mark.parametrize(("sigma", "cutoff"), [(1.3, 1), (2.0, 5), (0, 5), (0.8, 2)])
def test_gauss_kernel_1d(tmp_path, circular, normalized, sigma, cutoff):
    kernel = element(
        "it", "GaussKernel1D", "p", size=[1, 7], sigma=sigma, amplitude=2, circular=circular,
        normalized=normalized, cutoffFactor=cutoff,
    )  # fmt: skip
    found = shown(tmp_path, [1, 7], pattern("p", [1, 7], LINE), kernel)
    weights = taps(7, [(2, sigma)], math.ceil(sigma * cutoff), circular, normalized)
    close(found, convolved(LINE, weights, circular))


@pytest.mark.parametrize("circular", [1, 0])
@pytest.mark.parametrize("line", [LINE, LINE[:6]], ids=["odd", "even"])
@pytest.mark.parametrize("kind", ["MexicanHatKernel1D", "LateralInteractions1D"])
def test_both_gaussians_of_a_line_share_the_range_of_the_wider(tmp_path, kind, line, circular):
    n, whole = len(line), 0.5 if kind == "LateralInteractions1D" else 0.0
    shared = {"amplitudeGlobal": whole} if whole else {}
    kernel = element(
        "it", kind, "p", size=[1, n], sigmaExc=0.5, amplitudeExc=3, sigmaInh=1.2, amplitudeInh=2,
        circular=circular, normalized=1, cutoffFactor=2, **shared,
    )  # fmt: skip
    weights = taps(n, [(3, 0.5), (-2, 1.2)], 3, circular, True)
    wanted = [x + whole * sum(line) for x in convolved(line, weights, circular)]
    close(shown(tmp_path, [1, n], pattern("p", [1, n], line), kernel), wanted)


def test_a_kernel_of_its_own_is_that_of_the_field(tmp_path):
    kernel = element(
        "u -> u", "LateralInteractions1D", "u", size=[1, 9], sigmaExc=1, amplitudeExc=5, sigmaInh=2,
        amplitudeInh=3, amplitudeGlobal=-0.5, circular=1, normalized=1, cutoffFactor=5,
    )  # fmt: skip
    model = load(write(tmp_path, field("u", [1, 9], "u -> u"), kernel))
    assert not model.links and not model.ordered
    assert [type(term).__name__ for term in model["u"].kernel] == ["Gauss", "Gauss", "Global"]
    exact = load(tmp_path / "model.json", first_step=True)
    assert len(exact.links) == 2 and exact.state["u -> u"].eq(0).all()
    exact({})
    assert exact.state["u -> u"].ne(0).all()


def test_sums_over_a_field_become_its_global_term(tmp_path):
    own = element("sum", "SumDimension", "u", sumDimensions=[1, 2], size=[1, 1], amplitude=-0.2)
    model = load(write(tmp_path, field("u", [4, 5], "sum"), own), torch.float64)
    assert not model.links
    assert [(type(t).__name__, t.amplitude) for t in model["u"].kernel] == [("Global", -0.2)]


@pytest.mark.parametrize("kind", ["GaussKernel2D", "LateralInteractions2D", "MexicanHatKernel2D"])
def test_kernels_of_planes_go_along_each_axis(tmp_path, kind):
    ends = {"": (2.0, 1.1, 0.6)} if kind == "GaussKernel2D" else {
        "Exc": (2.0, 1.1, 0.6), "Inh": (1.0, 0.7, 0.0)
    }  # fmt: skip
    given = {"circularY": 0, "circularX": 1, "normalized": 1, "cutoffFactor": 1}
    if kind == "LateralInteractions2D":
        given["amplitudeGlobal"] = -0.1
    for end, (amplitude, y, x) in ends.items():
        given |= {f"amplitude{end}": amplitude, f"sigma{end}Y": y, f"sigma{end}X": x}
    kernel = element("it", kind, "p", size=[3, 3], **given)
    found = shown(tmp_path, [3, 3], pattern("p", [3, 3], SQUARE), kernel)
    wanted = torch.zeros(3, 3, dtype=torch.float64)
    for sign, (amplitude, y, x) in zip((1, -1), ends.values()):
        rows = [convolved(row, taps(3, [(1, x)], math.ceil(x), 1, True), 1) for row in SQUARE]
        columns = [
            convolved(list(column), taps(3, [(sign * amplitude, y)], math.ceil(y), 0, True), 0)
            for column in zip(*rows)
        ]
        wanted += torch.tensor(columns, dtype=torch.float64).t()
    close(found, wanted + given.get("amplitudeGlobal", 0.0) * sum(map(sum, SQUARE)))


def test_kernels_of_blocks(tmp_path):
    block = torch.zeros(3, 4, 5, dtype=torch.float64)
    block[1, 2, 3] = 1.0
    data = block.permute(2, 1, 0).flatten().tolist()
    array = {"_ArrayType_": "double", "_ArraySize_": [3, 4, 5], "_ArrayData_": data}
    ends = {"sigmaY": 0.5, "sigmaX": 0, "sigmaZ": 1}
    rings = {f"circular{end}": 1 for end in "YXZ"}
    kernel = element("it", "GaussKernel3D", "p", size=[3, 4, 5], amplitude=2, **ends, **rings)
    found = shown(tmp_path, [3, 4, 5], pattern("p", [3, 4, 5], array), kernel)
    assert float(found.sum()) == pytest.approx(2)
    assert found[:, 2].sum() == found.sum() and found[1, 2, 3] == found.max()
    ratio = float(found[1, 2, 4] / found[1, 2, 3])
    assert ratio == pytest.approx(math.exp(-0.5))


@pytest.mark.parametrize("circular", [1, 0])
def test_kernels_by_fft_are_not_cut_off(tmp_path, circular):
    kernel = element(
        "it", "KernelFFT", "p", size=[1, 7], sigmaExc=[[2]], amplitudeExc=3, sigmaInh=[[4]],
        amplitudeInh=1, amplitudeGlobal=-0.2, circular=[[circular]], normalized=0, paddingFactor=5,
    )  # fmt: skip
    weights = taps(7, [(3, 2), (-1, 4)], 7, circular, False)
    wanted = [x - 0.2 * sum(LINE) for x in convolved(LINE, weights, circular)]
    close(shown(tmp_path, [1, 7], pattern("p", [1, 7], LINE), kernel), wanted)


def test_kernels_by_fft_over_a_border_are_normalized_in_the_padded_ring(tmp_path):
    kernel = element(
        "it", "KernelFFT", "p", size=[2, 7], sigmaExc=[1, 1.5], amplitudeExc=3, circular=[1, 0],
        normalized=1, paddingFactor=5,
    )  # fmt: skip
    found = shown(tmp_path, [2, 7], pattern("p", [2, 7], [LINE, [0.0] * 7]), kernel)
    ring = sum(bell(d, 1.5) for d in range(-11, 12))  # 7 sites and 8 on both sides
    along = {d: bell(d, 1.5) / ring for d in range(-6, 7)}
    line = torch.tensor(convolved(LINE, along, 0), dtype=torch.float64)
    across = torch.tensor([1.0, math.exp(-0.5)], dtype=torch.float64)
    close(found, 3 * (across / across.sum()).unsqueeze(1) * line)


def test_transforms_forward_and_backward_are_a_kernel_by_fft(tmp_path):
    numbers = {"size": [1, 7], "sigmaExc": 2, "amplitudeExc": 3, "normalized": 1}
    start = pattern("p", [1, 7], LINE)
    forward = element("f", "FastFourierTransform", "p", size=[1, 7])
    two = shown(tmp_path, [1, 7], start, forward, element("it", "KernelInverseFFT", "f", **numbers))
    close(two, shown(tmp_path, [1, 7], start, element("it", "KernelFFT", "p", **numbers)))


@pytest.mark.parametrize("circular", [1, 0])
def test_shifted_kernels(tmp_path, circular):
    kernel = element(
        "it", "LateralInteractionsShifted1D", "p", size=[1, 7], sigmaExc=0.4, amplitudeExc=2,
        sigmaInh=1, amplitudeInh=0, amplitudeGlobal=0.5, shift=2, circular=circular, normalized=1,
        cutoffFactor=1,
    )  # fmt: skip
    found = shown(tmp_path, [1, 7], pattern("p", [1, 7], LINE), kernel)
    # On a ring the range is .4 around the shift, in whole sites, and holds the site itself.
    raw = {d: bell(d - 2, 0.4) for d in (range(4) if circular else range(-3, 4))}
    raw = {d: 2 * weight / sum(raw.values()) for d, weight in raw.items()}
    close(found, [x + 0.5 * sum(LINE) for x in convolved(LINE, raw, circular)])


def test_discrete_interactions(tmp_path):
    kernel = element("it", "LateralInteractionsDiscrete", "p", size=[2, 3], amplitudeExc=3,
                     amplitudeGlobal=-1)  # fmt: skip
    found = shown(tmp_path, [2, 3], pattern("p", [2, 3], PLANE), kernel)
    close(found, 3 * torch.tensor(PLANE) - 15)


@pytest.mark.parametrize(
    ("kind", "parameters", "wanted"),
    [
        ("ScaleInput", {"size": [1, 7], "amplitude": -2}, [-2 * x for x in LINE]),
        ("HalfWaveRectification", {"size": [1, 7]}, LINE),
        ("Sigmoid", {"size": [1, 7], "beta": 2, "threshold": 1},
         [1 / (1 + math.exp(-2 * (x - 1))) for x in LINE]),
        ("ShiftInput", {"size": [1, 7], "shiftValue": 2, "amplitude": 2, "circular": 1},
         [2 * x for x in LINE[-2:] + LINE[:-2]]),
        ("ShiftInput", {"size": [1, 7], "shiftValue": [0, -2], "circular": 0},
         [*LINE[2:], 0.0, 0.0]),
    ],
)  # fmt: skip
def test_functions_of_a_line(tmp_path, kind, parameters, wanted):
    it = element("it", kind, "p", **parameters)
    close(shown(tmp_path, [1, 7], pattern("p", [1, 7], LINE), it), wanted)


@pytest.mark.parametrize(
    ("size", "kind", "parameters", "component", "wanted"),
    [
        ([3, 2], "Transpose", {"size": [3, 2]}, "output", list(zip(*PLANE))),
        ([1, 3], "SumDimension", {"sumDimensions": 1, "size": [1, 3], "amplitude": 2}, "output",
         [8.0, 4.0, 18.0]),
        ([1, 2], "SumDimension", {"sumDimensions": 2, "size": [1, 2]}, "output", [8.0, 7.0]),
        ([1, 1], "SumDimension", {"sumDimensions": [1, 2], "size": [1, 1]}, "output", 15.0),
        ([1, 3], "SumAllDimensions", {"size": [2, 3]}, "verticalSum", [4.0, 2.0, 9.0]),
        ([1, 2], "SumAllDimensions", {"size": [2, 3]}, "horizontalSum", [8.0, 7.0]),
        ([1, 1], "SumAllDimensions", {"size": [2, 3]}, "fullSum", 15.0),
    ],
)  # fmt: skip
def test_functions_of_a_plane(tmp_path, size, kind, parameters, component, wanted):
    it = element("it", kind, "p", **parameters)
    start = pattern("p", [2, 3], PLANE)
    close(shown(tmp_path, size, start, it, component=component), wanted)


@pytest.mark.parametrize(
    ("size", "line", "kind", "parameters", "wanted"),
    [
        ([2, 3], [1.0, 2.0, 3.0], "ExpandDimension2D", {"expandDimension": 1, "size": [2, 3]},
         [[1.0, 2.0, 3.0]] * 2),
        ([2, 3], [1.0, 2.0], "ExpandDimension2D", {"expandDimension": 2, "size": [2, 3]},
         [[1.0] * 3, [2.0] * 3]),
        ([2, 3], [1.0, 2.0], "ExpandDimension",
         {"inputSize": [1, 2], "outputSize": [2, 3], "dimensionMapping": 1},
         [[1.0] * 3, [2.0] * 3]),
        ([1, 2], [1.0, 2.0, 3.0], "WeightMatrix",
         {"size": [3, 2], "weights": [[1, 0], [0, 1], [2, 2]]}, [7.0, 8.0]),
        ([1, 1], [1.0, 2.0, 3.0], "WeightMatrix", {"size": [3, 1], "weights": [[1], [0], [2]]},
         7.0),
    ],
)  # fmt: skip
def test_from_a_line_to_other_sizes(tmp_path, size, line, kind, parameters, wanted):
    start = pattern("p", [1, len(line)], line)
    close(shown(tmp_path, size, start, element("it", kind, "p", **parameters)), wanted)


def test_sums_of_blocks_may_turn(tmp_path):
    block = torch.arange(24, dtype=torch.float64).reshape(2, 3, 4)
    data = block.permute(2, 1, 0).flatten().tolist()
    array = {"_ArrayType_": "double", "_ArraySize_": [2, 3, 4], "_ArrayData_": data}
    total = element("it", "SumDimension", "p", sumDimensions=2, size=[4, 2], dimensionOrder=[2, 1])
    found = shown(tmp_path, [4, 2], pattern("p", [2, 3, 4], array), total)
    close(found, block.sum(1).t())


def test_diagonals(tmp_path):
    start = pattern("p", [3, 3], SQUARE)
    along = element("it", "DiagonalSum", "p", inputSize=[3, 3], amplitude=2)
    wanted = [0.0] * 5
    for row in range(3):
        for column in range(3):
            wanted[row + column] += 2 * SQUARE[row][column]
    close(shown(tmp_path, [1, 5], start, along), wanted)
    line = pattern("p", [1, 5], LINE[:5])
    back = element("it", "DiagonalExpansion", "p", inputSize=[1, 5], amplitude=2)
    close(shown(tmp_path, [3, 3], line, back), [[LINE[r + c] for c in range(3)] for r in range(3)])


def test_sums_and_products(tmp_path):
    start = (pattern("p", [1, 7], LINE), element("b", "BoostStimulus", amplitude=3))
    total = element("it", "SumInputs", "p", "b", "p", size=[1, 7])
    close(shown(tmp_path, [1, 7], *start, total), [2 * x + 3 for x in LINE])
    product = element("it", "PointwiseProduct", "p", "b", "p", size=[1, 7])  # of the first two
    close(shown(tmp_path, [1, 7], *start, product), [3 * x for x in LINE])


def test_columns_and_numbers_spread_over_a_plane(tmp_path):
    column = element("column", "Transpose", "p", size=[2, 1])
    total = element("it", "SumInputs", "column", "row", "b", size=[2, 3])
    start = pattern("p", [1, 2], [1.0, 2.0]), pattern("row", [1, 3], [10.0, 20.0, 30.0])
    found = shown(tmp_path, [2, 3], *start, element("b", "BoostStimulus", amplitude=100), column,
                  total)  # fmt: skip
    close(found, [[111.0, 121.0, 131.0], [112.0, 122.0, 132.0]])


@pytest.mark.parametrize("circular", [1, 0])
@pytest.mark.parametrize("normalized", [1, 0])
@pytest.mark.parametrize("sigma", [1.5, 0])
def test_stimuli_count_from_1(tmp_path, circular, normalized, sigma):
    stimulus = element("it", "GaussStimulus1D", size=[1, 7], sigma=sigma, amplitude=2, position=2,
                       circular=circular, normalized=normalized)  # fmt: skip
    away = [abs(x - 1) for x in range(7)]
    wanted = [bell(min(d, 7 - d) if circular else d, sigma) for d in away]
    total = sum(wanted) if normalized else 1
    close(shown(tmp_path, [1, 7], stimulus), [2 * x / total for x in wanted])


def test_stimuli_of_planes_and_blocks(tmp_path):
    numbers = {f"{name}{end}": value for end in "YXZ"
               for name, value in (("sigma", 1), ("circular", 0))}  # fmt: skip
    plane = element("it", "GaussStimulus2D", size=[4, 5], amplitude=3, positionY=2, positionX=5,
                    **numbers)  # fmt: skip
    found = shown(tmp_path, [4, 5], plane)
    close(found[1, 4], 3.0)
    close(found[2, 3], 3 * math.exp(-1.0))
    block = element("it", "GaussStimulus3D", size=[4, 5, 2], amplitude=3, positionY=2, positionX=5,
                    positionZ=1, **numbers)  # fmt: skip
    close(shown(tmp_path, [4, 5, 2], block)[1, 4, 1], 3 * math.exp(-0.5))


def test_noise_is_drawn_by_the_caller(tmp_path):
    it = element("it", "NormalNoise", size=[1, 7], amplitude=3)
    path = write(tmp_path, it, field("u", [1, 7], "it", tau=4, h=0), delta_t=4)
    assert noise(path) == {"it": (7,)}
    model = load(path, torch.float64)
    assert not model({})["u"].ne(0.5).any()
    xi = torch.randn(7, dtype=torch.float64)
    _, state = model.step({"it": xi}, model.initial([]))
    close(state["u"], 3 / 2 * xi)  # amplitude / sqrt(deltaT)


@pytest.mark.parametrize(
    ("it", "shape"),
    [
        (element("it", "TimedGaussStimulus1D", size=[1, 7], sigma=1, onTimes=[[0, 9]]), (7,)),
        (element("it", "TimedBoost", amplitude=3, onTimes=[[0, 9]]), ()),
        (element("it", "ColorExtraction", "camera", size=[2, 7]), (2, 7)),
    ],
    ids=lambda x: x["class"] if isinstance(x, dict) else None,
)
def test_what_comes_from_outside_is_an_input(tmp_path, it, shape):
    camera = element("camera", "CameraGrabber", size=[12, 16], deviceNumber=0)
    size = [2, 7] if len(shape) == 2 else [1, 7]
    assert not shown(tmp_path, size, camera, it).any()
    given = {"it": torch.full(shape, 2.0, dtype=torch.float64)}
    close(shown(tmp_path, size, camera, it, inputs=given), torch.full(size, 2.0).squeeze(0))
    assert load(tmp_path / "model.json")["camera"].value.shape == (12, 16, 3)


def test_memory_traces_go_a_share_of_the_way(tmp_path):
    """COSIVINA's trace takes 1 / tau of the way in each step, whatever deltaT is."""
    trace = element("m", "MemoryTrace", "p", size=[1, 7], tauBuild=4, tauDecay=10, threshold=0.5)
    path = write(tmp_path, pattern("p", [1, 7], LINE), trace, delta_t=2)
    model = load(path, torch.float64)
    wanted = [0.0] * 7
    for _ in range(3):
        model({})
        wanted = [m + (x - m) / 4 if x > 0.5 else m - m / 10 for m, x in zip(wanted, LINE)]
    close(model.state["m"], wanted)
    at_once = element("m", "MemoryTrace", "p", size=[1, 7], tauBuild=1, tauDecay=1)
    model = load(write(tmp_path, pattern("p", [1, 7], LINE), at_once), torch.float64)
    close(model({})["m"], LINE)


def test_fields_give_their_activation_and_resting_level(tmp_path):
    boost = element("b", "BoostStimulus", amplitude=2)
    path = write(
        tmp_path, boost, field("v", [1, 1], "b", tau=2, h=-1),
        field("u", [1, 3], ("v", "activation"), ("v", "h"), tau=1, h=0),
    )  # fmt: skip
    model = load(path, torch.float64)
    outputs, state = model.step({}, model.initial([]))
    close(state["v"], 0.0)  # from -1 half of the way to 1
    close(state["u"], [-1.0] * 3)  # v stands before u, which sees its new activation
    assert model.ordered and outputs["v"] == state["v"]


def test_the_order_of_the_file_counts_where_fields_read_each_other(tmp_path):
    boost = element("b", "BoostStimulus", amplitude=9)
    v, u = field("v", [1, 1], "b", tau=1, h=0), field("u", [1, 1], "v", tau=1, h=0)
    ahead = load(write(tmp_path, boost, v, u), torch.float64)
    assert ahead.ordered and ahead({})["v"].item() > 0.99 and ahead.state["u"].item() > 0.99
    behind = load(write(tmp_path, boost, u, v), torch.float64)
    behind({})
    assert not behind.ordered and behind.state["u"].item() == 0.5


def test_relays_may_read_each_other_in_a_circle(tmp_path):
    """A running sum: each step adds what it was a step before."""
    loop = element("sum", "SumInputs", "b", "back", size=[1, 1])
    back = element("back", "ScaleInput", "sum", size=[1, 1], amplitude=1)
    u = field("u", [1, 1], "sum", tau=1, h=0)
    model = load(write(tmp_path, element("b", "BoostStimulus", amplitude=1), loop, back, u),
                 torch.float64, first_step=True)  # fmt: skip
    for k in range(1, 4):
        model({})
        assert model.state["u"].item() == k


def test_what_acts_on_nothing_is_left_out(tmp_path):
    path = write(
        tmp_path, pattern("p", [1, 7], LINE), field("u", [1, 7], "off"),
        element("off", "ScaleInput", "p", size=[1, 7], amplitude=0),
        element("seen", "SumInputs", "u", ("u", "h"), size=[1, 7]),
        element("history", "RunningHistory", "u", size=[1, 7], timeSlots=9, interval=1),
        element("hebb", "AdaptiveWeightMatrix", "u", "u", size=[7, 7], learningRate=0.1),
    )  # fmt: skip
    model = load(path)
    assert list(model.labels()) == ["p", "u"] and not model.links
    exact = load(path, first_step=True)
    assert not exact.links

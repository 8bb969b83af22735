"""Bad files, and architectures without a form in COSIVINA: one sentence that says what is wrong."""

import json

import pytest
import torch
from cosivina_models import element, field, pattern, write

from dntorch import DNF, Architecture, Gauss, Global, Matrices, MemoryTrace, NodeWTA, Relay
from dntorch.cosivina import load, save

GAUSS = {"size": [1, 7], "sigma": 1, "amplitude": 2, "circular": 1, "normalized": 1}


def without(parameters, *names):
    return {name: value for name, value in parameters.items() if name not in names}


@pytest.mark.parametrize(
    ("elements", "sentence"),
    [
        ([element("x", "Foo")], "model.json: element 'x' of class Foo: the class is unknown"),
        ([element("u", "NeuralField", size=[1, 7], tau=10, h=-5)],
         "model.json: element 'u' of class NeuralField: parameter 'beta' is missing"),
        ([field("u", [1, 7], "k"), element("k", "GaussKernel1D", "u", **without(GAUSS, "sigma"))],
         "element 'k' of class GaussKernel1D: parameter 'sigma' is missing"),
        ([field("u", [1, 7], "w")],
         "model.json: element 'u' of class NeuralField: its input 'w' is no element of the file"),
        ([field("u", [1, 7]), field("u", [1, 7])],
         "element 'u' of class NeuralField: another element has this label"),
        ([pattern("p", [1, 5], [1.0] * 5), field("u", [1, 7], "p")],
         r"element 'u' of class NeuralField: its input 'p' of size \[1, 5\] does not fit \[1, 7\]"),
        ([field("v", [1, 5]), field("u", [1, 7], "k"), element("k", "GaussKernel1D", "v", **GAUSS)],
         r"element 'k' of class GaussKernel1D: its input 'v' of size \[1, 5\] does not fit"),
        ([field("u", [1, 7], "k"), element("k", "GaussKernel1D", "u", **GAUSS | {"sigma": -1})],
         "element 'k' of class GaussKernel1D: sigma=-1: give one number of at least 0"),
        ([field("u", [1, 7], "k"),
          element("k", "KernelFFT", "u", size=[1, 7], sigmaExc=-2, amplitudeExc=1)],
         "element 'k' of class KernelFFT: sigmaExc"),
        ([field("u", [1, 7], tau=0)], "element 'u' of class NeuralField: tau=0 must be positive"),
        ([field("u", [1, 7], tau=0.5)], "tau=0.5 is shorter than deltaT=1"),
        ([field("u", [1, 0])], r"element 'u' of class NeuralField: size=\[1, 0\]"),
        ([field("u", "big")], "element 'u' of class NeuralField: size='big': give numbers"),
        ([field("u", [1, 7], h="_NaN_")], "element 'u' of class NeuralField: h=nan"),
        ([field("u", [1, 7], ("v", "speed")), field("v", [1, 7])],
         "element 'v' of class NeuralField: it has no component 'speed'"),
        ([field("u", [1, 7], "x"), element("x", "PointwiseProduct", "u", size=[1, 7])],
         "element 'x' of class PointwiseProduct: it has 1 of 2 inputs"),
        ([field("u", [1, 7], "x"), element("x", "HebbianConnection", "u", "u")],
         "element 'x' of class HebbianConnection: it is not supported, since it learns weights"),
        ([field("u", [1, 7], "x"), element("x", "TimedSwitch", "u", size=[1, 7], onTimes=[])],
         "element 'x' of class TimedSwitch: it is not supported"),
        ([field("u", [1, 7], "f"), element("f", "FastFourierTransform", "u", size=[1, 7])],
         "element 'u' of class NeuralField: its input 'f' is a FastFourierTransform"),
        ([field("u", [1, 7], ("v", "activation")), field("v", [1, 7], "s"),
          element("s", "ScaleInput", "v", size=[1, 7], amplitude=1)],
         "element 'v' of class NeuralField: 'u' reads its activation, and something"),
        ([field("u", [1, 7], "v", ("v", "activation")), field("v", [1, 7])],
         "element 'v' of class NeuralField: 'u' reads its activation, and something"),
        ([element("m", "MemoryTrace", tauBuild=0, tauDecay=9, size=[1, 7])],
         "element 'm' of class MemoryTrace: tauBuild=0: give one number of at least 1"),
        ([pattern("p", [1, 7], [1.0, 2.0]), field("u", [1, 7], "p")],
         "element 'p' of class CustomStimulus: pattern of 2 numbers does not fit"),
        ([field("u", [2, 7]), field("v", [1, 2], "s"),
          element("s", "SumDimension", "u", sumDimensions=1, size=[1, 2])],
         r"element 's' of class SumDimension: what is left of an input of size \[2, 7\]"),
        ([field("u", [2, 2, 2, 2])], "element 'u' of class NeuralField: shape="),
        ([element("p", "BoostStimulus", amplitude=1)], "model.json has no NeuralField"),
        ([field("u", [3, 7], "k"), element("k", "GaussKernel1D", "u", **GAUSS | {"size": [3, 7]})],
         r"element 'k' of class GaussKernel1D: size=\[3, 7\] is no line"),
        ([field("u", [1, 7], "s"), element("s", "ShiftInput", "u", size=[1, 7], shiftValue=1,
          fillValue=3)], "element 's' of class ShiftInput: fillValue"),
    ],
)  # fmt: skip
def test_an_element_that_does_not_fit_is_named(tmp_path, elements, sentence):
    with pytest.raises(ValueError, match=sentence):
        load(write(tmp_path, *elements))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"simulator": {"deltaT": 1,, }}', r"model.json is no JSON: .* in line 1, column"),
        ("", "model.json is no JSON: .* in line 1, column 1"),
        ("[1, 2]", "model.json is no COSIVINA parameter file"),
        ('{"name": "something else"}', "model.json is no COSIVINA parameter file"),
        ('{"simulator": {"deltaT": 0, "elements": []}}', "model.json: deltaT=0"),
        ('{"simulator": {"deltaT": 1, "elements": [3]}}', "model.json: element 1 has no 'label'"),
        ('{"simulator": {"deltaT": 1, "elements": [{"label": "u", "class": "NeuralField", '
         '"param": 3}]}}', "element 'u' of class NeuralField: 'param' is no object"),
        ('{"simulator": {"deltaT": 1, "elements": [{"label": "u", "class": "NeuralField", '
         '"param": {}, "input": [3]}]}}', "element 'u' of class NeuralField: input 3 names no"),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_refused(tmp_path, text, sentence):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=sentence):
        load(path)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "model.json"
    path.write_bytes(b'{"\xff')
    with pytest.raises(ValueError, match=r"model.json is no text at byte 2"):
        load(path)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nowhere.json")


def one(**elements):
    return Architecture(elements)


@pytest.mark.parametrize(
    ("architecture", "sentence"),
    [
        (lambda: one(n=NodeWTA(3)), "element 'n', a NodeWTA, has no class"),
        (lambda: one(u=DNF(3, kind="abs")), "element 'u': .* this one is 'abs'"),
        (lambda: one(u=DNF(3, threshold=0.5)), "element 'u': .* threshold=0.5"),
        (lambda: one(u=DNF(3, substeps=2)), "element 'u': .* substeps=2"),
        (lambda: one(m=MemoryTrace(3, frozen=False)), "element 'm': .* frozen"),
        (lambda: one(u=DNF((3, 3), (Matrices((torch.eye(3), torch.eye(3))),))), "'u -> u': a kern"),
        (lambda: Architecture({"u": DNF((2, 3)), "v": DNF(3)}, ("u", "v", "y x -> x", 1.0,
                              "circular", "max")), "link 'u -> v': reduce='max'"),
        (lambda: Architecture({"u": DNF((2, 3)), "v": DNF(4)}, ("u", "v", "y x -> y+x")),
         "link 'u -> v': diagonals"),
        (lambda: Architecture({"u": DNF(3), "r": Relay(3, kind="abs")}, ("r", "u")),
         "element 'r', a Relay of kind 'abs'"),
        (lambda: one(u=DNF(3, h=torch.tensor([-5.0, -4.0]))), "element 'u': h has one number per"),
    ],
)  # fmt: skip
def test_what_has_no_form_in_cosivina_is_not_saved(tmp_path, architecture, sentence):
    with pytest.raises(ValueError, match=sentence):
        save(architecture(), tmp_path / "model.json")
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="noise has 'x', which is no input"):
        save(one(u=DNF(3)), tmp_path / "model.json", noise=["x"])
    with pytest.raises(TypeError, match="architecture is a DNF: give an Architecture"):
        save(DNF(3), tmp_path / "model.json")


def test_an_architecture_of_all_that_has_a_form_is_saved(tmp_path):
    kernel = (Gauss(6.0, 1.5), Gauss(-2.0, 3.0, shift=1.0), Global(-0.1))
    dt = 1 / 64
    model = Architecture(
        {
            "plane": DNF((4, 9), (Gauss(5.0, (1.0, 2.0)), Global(-0.05)), h=-2.0,
                         border=("zero", "circular"), dt=dt, dtype=torch.float64),
            "line": DNF(9, kernel, h=-1.0, dt=dt, dtype=torch.float64),
            "block": DNF((2, 4, 9), (), dt=dt, h=0.5, dtype=torch.float64),
            "node": DNF((), (Global(2.0),), h=-0.5, dt=dt, dtype=torch.float64),
            "trace": MemoryTrace(9, 0.5, 2.0, 0.1, dt=dt, dtype=torch.float64),
            "both": Relay(9, "product"),
            "soft": Relay((), kind="logistic", steepness=2.0, threshold=1.0),
            "none": Relay(9),
        },
        ("plane", "line", "y x -> x", (Gauss(2.0, 1.0), Global(0.1)), "circular", "mean"),
        ("line", "plane", "x -> y x", 1.5),
        ("plane", "block", "y x -> z y x", (Gauss(1.0, 1.0),), "zero"),
        ("block", "plane", "z y x -> y x"),
        ("line", "trace"), ("trace", "line", (Gauss(1.0, 2.0),)),
        ("line", "both"), ("trace", "both"), ("both", "line", 0.5), ("none", "line"),
        ("plane", "soft", "y x ->"), ("soft", "node"), ("node", "line", "-> x", 0.3),
        ("cue", "plane"), ("xi", "line", 0.2),
        inputs={"cue": torch.rand(4, 9), "xi": 9},
    )  # fmt: skip
    save(model, tmp_path / "model.json", noise=["xi"])
    again = load(tmp_path / "model.json", torch.float64)
    assert not again.ordered
    state, other = model.initial([]), again.initial([])
    for _ in range(20):
        given = {"xi": torch.randn(9, dtype=torch.float64)}
        _, state = model.step(given, state)
        _, other = again.step(given, other)
    for label in state:
        torch.testing.assert_close(other[label], state[label], rtol=0, atol=1e-10)
    written = json.loads((tmp_path / "model.json").read_text())["simulator"]
    assert written["nElements"] == len(written["elements"]) == len(set(written["elementLabels"]))
    assert written["deltaT"] == 15.625


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"simulator": {"deltaT": 1, "elements": ' + "[" * 900 + "]" * 900 + "}}", "nested too"),
        ('{"simulator": {"deltaT": 1' + "0" * 5000 + "}}", "is no JSON: Exceeds"),
        ('{"simulator": {"deltaT": 1' + "0" * 400 + ', "elements": []}}', "deltaT=10000"),
        ('{"simulator": {"deltaT": {"_ArraySize_": [{}], "_ArrayData_": [1]}, "elements": []}}',
         "deltaT="),
        ('{"simulator": {"deltaT": 1, "elements": [{"label": "", "class": "NeuralField"}]}}',
         "element 1 has no 'label'"),
        ('{"simulator": {"deltaT": 1, "elements": [{"label": "u", "class": "a\\nb"}]}}',
         "the class is unknown"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=sentence) as raised:
        load(path)
    assert raised.type is ValueError and str(raised.value).startswith("model.json")
    assert "\n" not in str(raised.value)


NUMBERS = [10**400, 1e308, -1e308, "_Inf_", float("inf"), float("nan"), {"_ArraySize_": [1e308]}]
HAT = {"sigmaExc": 1, "amplitudeExc": 2, "sigmaInh": 2, "amplitudeInh": 1, "amplitudeGlobal": 0}


@pytest.mark.parametrize(
    ("kind", "parameters", "names"),
    [
        ("NeuralField", {"tau": 10, "h": -5, "beta": 4}, ["size", "tau", "h", "beta"]),
        ("MemoryTrace", {"tauBuild": 9, "tauDecay": 9}, ["size", "tauBuild", "threshold"]),
        ("GaussKernel1D", GAUSS, ["size", "sigma", "amplitude", "cutoffFactor", "circular"]),
        ("MexicanHatKernel1D", HAT | {"circular": 0, "normalized": 1},
         ["size", "sigmaExc", "amplitudeInh", "amplitudeGlobal", "cutoffFactor"]),
        ("LateralInteractionsShifted1D", HAT | {"circular": 1, "normalized": 1},
         ["size", "shift", "sigmaExc", "cutoffFactor"]),
        ("KernelFFT", HAT | {"circular": 0, "normalized": 1}, ["paddingFactor", "sigmaExc"]),
        ("ShiftInput", {"shiftValue": 1}, ["size", "shiftValue", "amplitude", "fillValue"]),
        ("ScaleInput", {"amplitude": 1}, ["amplitude"]),
        ("WeightMatrix", {"size": [7, 7], "weights": [1] * 49}, ["size", "weights"]),
        ("Transpose", {}, ["size"]),
        ("CustomStimulus", {"pattern": [1] * 7}, ["pattern"]),
        ("GaussStimulus1D", {"sigma": 1, "amplitude": 1, "position": 3, "circular": 1},
         ["size", "sigma", "amplitude", "position"]),
    ],
)  # fmt: skip
def test_a_number_that_is_none_is_named_with_element_and_file(tmp_path, kind, parameters, names):
    given = {"size": [1, 7]} | parameters
    inputs = [] if kind in ("NeuralField", "CustomStimulus", "GaussStimulus1D") else ["u"]
    sizes = [[1, 2, 3], 1e15] if kind in ("WeightMatrix", "Transpose") else [1e15]
    for name in names:
        for wrong in NUMBERS + sizes * (name == "size"):
            part = element("x", kind, *inputs, **given | {name: wrong})
            with pytest.raises(ValueError, match=f"element 'x' of class {kind}: ") as raised:
                load(write(tmp_path, part, field("u", [1, 7], "x")))
            assert raised.type is ValueError and "\n" not in str(raised.value)


def test_whole_numbers_are_not_rounded(tmp_path):
    for kind, parameters in (
        ("SumDimension", {"size": [1, 7], "sumDimensions": 1.5}),
        ("ExpandDimension", {"inputSize": [1, 7], "outputSize": [3, 7], "dimensionMapping": 2.5}),
    ):
        with pytest.raises(ValueError, match=f"class {kind}: .*give whole numbers"):
            load(write(tmp_path, element("x", kind, "u", **parameters), field("u", [1, 7])))
    shift = element("x", "ShiftInput", "u", size=[1, 7], shiftValue=[1, 2, 3])
    with pytest.raises(ValueError, match=r"shiftValue=\[1.0, 2.0, 3.0\] does not fit"):
        load(write(tmp_path, shift, field("u", [1, 7])))


def test_a_kernel_on_a_single_site_is_a_gain(tmp_path):
    for kind, more in (("LateralInteractionsShifted1D", {"shift": 0}), ("KernelFFT", {})):
        part = element("x", kind, "u", size=[1, 1], circular=0, normalized=1, **HAT, **more)
        model = load(write(tmp_path, part, field("u", [1, 1], "x")))
        assert float(model["u"].everywhere) == pytest.approx(1.0)  # 2 - 1


def test_a_long_chain_of_elements_is_loaded(tmp_path):
    def sigmoid(k, source):
        return element(f"c{k}", "Sigmoid", source, size=[1, 7], beta=1, threshold=0)

    chain = [sigmoid(k, f"c{k - 1}" if k else "u") for k in range(1200)]
    assert load(write(tmp_path, field("u", [1, 7], "c1199"), *chain)).ordered


def test_arguments_of_load_and_save_are_checked(tmp_path):
    path = write(tmp_path, field("u", [1, 7]))
    model = load(path)
    for run in (
        lambda: load(None), lambda: load(b"x"), lambda: load("a\0b"), lambda: load(""),
        lambda: load(path, "float64"), lambda: load(path, first_step="no"),
        lambda: save(model, None), lambda: save(model, ""), lambda: save(model, "a\0b"),
        lambda: save(model, path, noise="xi"), lambda: save(model, path, noise=None),
        lambda: save(model, path, noise=[["xi"]]),
        lambda: save(one(**{"\ud800": DNF(3)}), path),
        lambda: save(Architecture({"u": DNF(1), "v": DNF(3)}, ("u", "v", "x -> x",
                     Matrices((torch.ones(3, 1),)))), path),
    ):  # fmt: skip
        with pytest.raises((ValueError, TypeError)) as raised:
            run()
        assert raised.type in (ValueError, TypeError)
        assert "\n" not in str(raised.value) and ": " in str(raised.value)
    with pytest.raises(OSError, match="cannot be written"):
        save(model, tmp_path / "nowhere" / "model.json")
    assert len(load(path)["u"].shape) == 1  # nothing was written


def test_widths_in_a_list_and_learned_numbers_are_saved(tmp_path):
    a = torch.tensor(2.0, requires_grad=True)
    model = one(u=DNF((3, 4), Gauss(a, [1.0, 2.0]), h=0.0))
    save(model, tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    for _ in range(3):
        assert torch.allclose(again({})["u"], model({})["u"])

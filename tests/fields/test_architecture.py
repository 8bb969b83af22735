"""Architectures: what they compute, in whatever order they were written."""

import copy
import itertools
import random

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dntorch import (
    DNF,
    Architecture,
    Gauss,
    Global,
    Link,
    MemoryTrace,
    NodeWTA,
    Projection,
    Relay,
    TPCell,
    gauss,
    rollout,
)
from dntorch.cells.functions import logistic
from dntorch.modules.wiring import escaped

D = torch.float64


def elements(dtype=D):
    return {
        "scene": DNF((3, 20), (), dtype=dtype),
        "space": DNF(20, Gauss(6.0, 1.5), dtype=dtype),
        "trace": MemoryTrace(20, 0.3, dtype=dtype),
        "sum": Relay(20),
    }


LINKS = [
    ("scene", "space", "c p -> p", Gauss(3.0, 1.0)),
    ("space", "scene", "p -> c p", 1.5),
    ("space", "trace"),
    ("trace", "sum", 2.0),
    ("cue", "sum"),
    ("sum", "space"),
]


def built(parts=None, links=LINKS, dtype=D, **how):
    cue = gauss(20, torch.tensor(4.0, dtype=dtype), 2.0, 3.0)
    return Architecture(parts or elements(dtype), *links, inputs={"cue": cue}, **how)


def noise(*shape, seed=0):
    return torch.randn(shape, dtype=D, generator=torch.Generator().manual_seed(seed))


def awake(model):
    state = {k: noise(*x.shape, seed=len(k)).abs() for k, x in model.state.items()}
    model.state = state
    return model


def test_a_step_is_the_equations():
    model = awake(built())
    before = model.state
    outputs, after = model.step({"scene": noise(3, 20), "sum": noise(20, seed=1)}, before)
    scene, space = (logistic(before[name], 4.0, 0.0) for name in ("scene", "space"))
    row = Gauss(6.0, 1.5), Gauss(3.0, 1.0)
    own, across = (DNF(20, term, dtype=D).kernel_0[0] for term in row)
    rate = 1 / 32 / 0.1
    into = noise(3, 20) + 1.5 * space
    u = before["scene"]
    torch.testing.assert_close(after["scene"], u + rate * (-u - 5 + into))
    v, reached = before["space"], 2 * before["trace"] + model["cue"].value + noise(20, seed=1)
    expected = v + rate * (-v - 5 + own @ space + across @ scene.sum(0) + reached)
    torch.testing.assert_close(after["space"], expected)
    alone = MemoryTrace(20, 0.3, dtype=D)
    alone.trace.copy_(before["trace"])
    torch.testing.assert_close(after["trace"], alone(space))
    torch.testing.assert_close(outputs["space"], logistic(after["space"], 4.0, 0.0))
    assert outputs.keys() == after.keys() == {"scene", "space", "trace"}


def test_links_are_listed_with_their_projections_and_build_the_same_again():
    model = built()
    again = built(links=model.links)
    assert [(a, b) for a, b, _ in again.links] == [(a, b) for a, b, _ in model.links]
    assert sorted((a, b) for a, b, _ in model.links) == sorted((a, b) for a, b, *_ in LINKS)
    (across,) = (x.projection for x in model.links if (x.source, x.target) == ("scene", "space"))
    assert across.axes == "c p -> p" and across.kernel == (Gauss(3.0, 1.0),)


def test_elements_and_links_in_any_order_are_the_same_to_the_last_bit():
    shuffle, given = random.Random(0), {"scene": 4 * noise(3, 20)}
    states = []
    for _ in range(6):
        parts, links = list(elements().items()), list(LINKS)
        shuffle.shuffle(parts)
        shuffle.shuffle(links)
        model = awake(built(dict(parts), links))
        for _ in range(20):
            model(given)
        states.append(model.state)
    for state, name in itertools.product(states[1:], states[0]):
        assert torch.equal(state[name], states[0][name])


def test_links_between_the_same_two_in_any_order_are_the_same_to_the_last_bit():
    several = [("a", "b", Gauss(3.3, 1.7)), ("a", "b", Gauss(-1.1, 4.3)), ("a", "b", 0.71),
               ("a", "b", "x -> x", 0.37)]  # fmt: skip
    states, given = [], {"a": 9 * noise(20, 20).abs(), "b": noise(20, 20, seed=1)}
    for links in itertools.permutations(several):
        model = Architecture({"a": DNF(20, dtype=D), "b": DNF(20, dtype=D)}, *links)
        states.append(rollout(model, given)[1]["b"])
    assert all(torch.equal(state, states[0]) for state in states)


def test_a_ring_has_no_special_place():
    links = [link for link in LINKS if link[0] != "cue"]
    near, far = awake(built(links=links)), built(links=links)
    far.state = {k: x.roll(5, -1) for k, x in near.state.items()}
    cue = noise(3, 20, seed=7)
    for _ in range(10):
        one, other = near({"scene": cue}), far({"scene": cue.roll(5, -1)})
    for name in one:
        torch.testing.assert_close(one[name].roll(5, -1), other[name], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("order", [None, ["scene", "space", "trace", "sum"]])
def test_a_row_of_a_batch_is_the_run_alone(order):
    whole = built(order=order)
    whole.spread(3)
    given = {"scene": 5 * noise(4, 3, 3, 20), "cue": noise(4, 3, 20)}
    outputs, _ = rollout(whole, given)
    for k in range(3):
        alone, _ = rollout(built(order=order), {name: x[:, k] for name, x in given.items()})
        for name in alone:
            torch.testing.assert_close(outputs[name][:, k], alone[name])


def test_a_trace_among_the_elements_is_long_term_memory():
    model = built()
    model.spread(2)
    for _ in range(64):
        model({"space": 8 * noise(2, 20)})
    held = model.state["trace"]
    assert held.any(-1).all() and not torch.equal(held[0], held[1])
    model.reset()
    assert torch.equal(model.state["trace"], held)
    assert (model.state["space"] == -5).all()
    kept = {name: x.clone() for name, x in model.state_dict().items()}
    other = built()
    other.spread(2)
    other.load_state_dict(kept)
    assert torch.equal(other.state["trace"], held)
    assert torch.equal(model.select(1).state["trace"], held[1])
    model.forget()
    assert not model.state["trace"].any()


# ------------------------------------------------------------------ order


def one_after_the_other(order, given, steps, filled):
    """A model of three elements in plain numbers, as COSIVINA would step it."""
    shown = {"u": 1 / (1 + 2.718281828459045**20), "v": 1 / (1 + 2.718281828459045**20)}
    shown["r"] = 2 * shown["u"] if filled else 0.0
    u = {"u": -5.0, "v": -5.0}
    for _ in range(steps):
        for name in order:
            if name == "r":
                shown["r"] = 2 * shown["u"]
                continue
            reaching = given if name == "u" else shown["r"]
            u[name] += (1 / 32) / 0.1 * (-u[name] - 5 + reaching)
            shown[name] = 1 / (1 + 2.718281828459045 ** (-4 * u[name]))
    return u


@pytest.mark.parametrize("order", list(itertools.permutations(["u", "v", "r"])), ids="".join)
@pytest.mark.parametrize("filled", [True, False])
def test_with_an_order_elements_step_one_after_the_other(order, filled):
    parts = {"u": DNF((), (), dtype=D), "v": DNF((), (), dtype=D), "r": Relay(())}
    model = Architecture(parts, ("u", "r", 2.0), ("r", "v"), order=order, filled=filled)
    for steps in range(1, 9):
        model({"u": torch.tensor(9.0, dtype=D)})
        expected = one_after_the_other(order, 9.0, steps, filled)
        for name in ("u", "v"):
            assert float(model.state[name]) == pytest.approx(expected[name], rel=1e-12)
    assert ("r" in model.state) == (order.index("r") > order.index("v"))


def test_torchscript_does_not_take_one_order_for_another():
    parts = {"u": DNF((), ()), "v": DNF((), ()), "r": Relay(())}
    for order in itertools.permutations(parts):
        model = Architecture(copy.deepcopy(parts), ("u", "r", 9.0), ("r", "v"), order=order)
        model({"u": torch.tensor(9.0)})
        state = model.state
        expected = model.step({}, state)[1]
        actual = torch.jit.script(model).step({}, state)[1]
        assert all(torch.equal(actual[name], expected[name]) for name in expected), order


# ------------------------------------------------------------------ folding


def coupled(dtype, **options):
    parts = {
        "u": DNF(12, Gauss(4.0, 1.0), tau=0.08, h=-4.0, dtype=dtype, **options),
        "v": DNF((3, 4), (Gauss(2.0, 0.7), Global(-0.2)), tau=0.05, dtype=dtype, **options),
        "n": DNF((), (), steepness=2.0, threshold=0.5, dtype=dtype, **options),
        "relay": Relay(12),
        "far": Relay(12),
    }
    return Architecture(
        parts,
        ("u", "relay", Gauss(3.0, 2.0)),
        ("cue", "relay"),
        ("relay", "far", 0.5),
        ("far", "u"),
        ("far", "v", "x -> a b", 0.2),
        ("v", "n", "a b ->", 3.0, "circular", "mean"),
        ("n", "u", "-> x", -2.0),
        ("free", "v", "x -> a x"),
        inputs={"cue": gauss(12, 3.0, 2.0, 6.0).to(dtype), "free": 4},
    )


@pytest.mark.parametrize(("dtype", "tolerance"), [(D, 1e-12), (torch.float32, 1e-5)])
@pytest.mark.parametrize("kind", ["logistic", "abs", "semilinear", "heaviside", "linear"])
def test_folded_is_unfolded_to_rounding(kind, dtype, tolerance):
    model = coupled(dtype, kind=kind)
    folded = model.fold()
    names = list(model.labels())
    for step in range(40):
        shapes = {name: model._shapes[name] for name in names}
        given = {
            name: 3 * noise(*shapes[name], seed=step).to(dtype)
            for k, name in enumerate(names)
            if (step >> (k % 4)) % 2
        }
        outputs, same = model(given), folded(given)
        for name in outputs:
            torch.testing.assert_close(same[name], outputs[name], rtol=tolerance, atol=tolerance)
        folded.state = model.state  # a site at a threshold may fall to either side
    assert model.state["u"].max() > 0 or kind == "linear"  # which runs away
    model.resize(2, 3)
    folded.resize(2, 3)
    given = {"u": noise(2, 3, 12).to(dtype), "cue": noise(2, 3, 12).to(dtype)}
    torch.testing.assert_close(
        folded(given)["v"], model(given)["v"], rtol=tolerance, atol=tolerance
    )
    folded.reset()
    assert (folded.state["u"] == -4).all() and (folded.state["v"] == -5).all()


def test_what_cannot_be_folded_is_named():
    parts = {
        "u": DNF(5), "fine": DNF(5, substeps=2), "sharp": DNF(5, kind="heaviside"),
        "m": MemoryTrace(5), "k": NodeWTA(5), "p": Relay(5, "product"),
        "f": Relay(5, kind="semilinear"),
    }  # fmt: skip
    links = ("u", "p"), ("m", "p"), ("p", "k"), ("u", "k", "x -> y", 1.0, "circular", "max")
    with pytest.raises(ValueError, match="fold") as raised:
        Architecture(parts, *links).fold()
    for words in (
        "'fine' has sub-steps", "'sharp' is 'heaviside'", "'m' is a MemoryTrace",
        "'k' is a NodeWTA", "'p' multiplies", "'f' has the output function",
        "('u', 'k') takes a max",
    ):  # fmt: skip
        assert words in str(raised.value)
    with pytest.raises(ValueError, match="one after the other"):
        built({"u": DNF(20, dtype=D)}, [("cue", "u")], order=["u"]).fold()
    with pytest.raises(ValueError, match="sites are too many"):
        Architecture({"u": DNF((100, 100))}).fold()


# ------------------------------------------------------------------ names


@settings(max_examples=300, deadline=None)
@given(st.lists(st.text(min_size=1), min_size=2, max_size=2, unique=True))
def test_names_of_modules_are_one_to_one(labels):
    names = [escaped(label) for label in labels]
    assert names[0] != names[1]
    for name in names:
        assert name.isascii() and name and "." not in name
        assert name not in dir(torch.nn.ModuleDict())


@pytest.mark.parametrize(
    "label", ["keys", "a.b", "v -> u (inh.)", "Größe", "_x20_", " ", "training"]
)
def test_any_label_names_inputs_outputs_and_state(label, tmp_path):
    model = Architecture({label: DNF(4), "m": MemoryTrace(4)}, (label, "m"))
    scripted = torch.jit.script(model)
    torch.jit.save(scripted, tmp_path / "model.pt")
    loaded = torch.jit.load(tmp_path / "model.pt")
    given = {label: torch.full((4,), 9.0)}
    for _ in range(5):
        outputs, again = model(given), loaded(given)
    assert torch.equal(outputs[label], again[label]) and outputs[label].min() > 0.5
    assert set(model.state) == {label, "m"} and isinstance(model[label], DNF)


# ------------------------------------------------------------------ gradients, rollout


def test_rollout_is_step_after_step_and_changes_nothing():
    model, given = built(), {"scene": noise(7, 3, 20)}
    start = model.state
    outputs, states = rollout(model, given)
    assert all(torch.equal(model.state[name], start[name]) for name in start)
    for k in range(7):
        expected = model({"scene": given["scene"][k]})
        assert all(torch.equal(outputs[name][k], expected[name]) for name in expected)
        assert all(torch.equal(states[name][k], x) for name, x in model.state.items())
    alone, _ = rollout(built(), {}, steps=7)  # its cue acts by itself
    expected, _ = rollout(built(), {"cue": torch.zeros(7, 20, dtype=D)})
    assert all(torch.equal(alone[name], expected[name]) for name in expected)
    for steps in (0, 1.5, True, 6):
        with pytest.raises(ValueError, match="steps"):
            rollout(model, given, steps=steps)
    fields, _ = rollout(DNF(5), torch.zeros(3, 5))
    assert fields.shape == (3, 5)
    for wrong in ({"scene": torch.zeros(())}, {"a": torch.zeros(2, 5), "b": torch.zeros(3, 5)}, {}):
        with pytest.raises(ValueError, match="inputs have lengths"):
            rollout(model, wrong)


def test_gradients_of_kernels_inputs_and_states_are_right():
    parts = {"u": DNF(5, (), dtype=D), "v": DNF((2, 5), (), h=-1.0, dtype=D)}
    model = Architecture(parts, ("u", "v", "x -> y x"), ("v", "u", "y x -> x"))

    def run(amplitude, sigma, gain, given, u):
        parts["u"].kernel = (Gauss(amplitude, sigma), Global(-amplitude / 9))
        model.links[1].projection.kernel = gain
        state = model.initial([]) | {"u": u}
        outputs, _ = rollout(model, {"u": given}, state)
        return outputs["u"], outputs["v"]

    numbers = [torch.tensor(x, dtype=D, requires_grad=True) for x in (3.0, 1.2, 0.7)]
    tensors = noise(3, 5).requires_grad_(), noise(5, seed=1).requires_grad_()
    assert torch.autograd.gradcheck(run, (*numbers, *tensors))


# ------------------------------------------------------------------ wrong input


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Architecture({}), "at least one with a state"),
        (lambda: Architecture([DNF(5)]), "is no mapping"),
        (lambda: Architecture({"u": 3}), r"elements\['u'\] is a int: give"),
        (lambda: Architecture({"": DNF(5)}), "has the name ''"),
        (lambda: Architecture({3: DNF(5)}), "has the name 3"),
        (lambda: Architecture({"u": DNF(5)}, ("u", "w")), "target 'w' is not there"),
        (lambda: Architecture({"u": DNF(5)}, ("w", "u")), "source 'w' is not there"),
        (lambda: Architecture({"u": DNF(5)}, ("u", "s"), inputs={"s": 5}), "target 's' is not"),
        (lambda: Architecture({"u": DNF(5)}, ("u",)), r"link \('u',\): give"),
        (lambda: Architecture({"u": DNF(5)}, "uu"), "link 'uu': give"),
        (lambda: Architecture({"u": DNF(5), "v": DNF(6)}, ("u", "v")), "name the axes"),
        (lambda: Architecture({"u": DNF(5)}, ("u", "u", Gauss(1.0, -1.0))), "sigma=-1.0"),
        (lambda: Architecture({"u": DNF(5)}, ("u", "u", "x")), "axes='x' is no pattern"),
        (lambda: Architecture({"u": DNF(5)}, inputs={"u": 5}), "inputs has 'u', which is an"),
        (lambda: Architecture({"u": DNF(5)}, inputs={"s": -1}), r"inputs\['s'\]=-1: give"),
        (lambda: Architecture({"u": DNF(5)}, order=[]), "order has 'u' 0 times"),
        (lambda: Architecture({"u": DNF(5)}, order=["u", "u"]), "order has 'u' 2 times"),
        (lambda: Architecture({"u": DNF(5)}, order=["u", "w"]), "order has 'w' 1 times"),
        (lambda: Architecture({"u": DNF(5), "v": DNF(5, dt=0.01)}), "dt=0.01 does not fit"),
        (lambda: Architecture({"t": TPCell(3)}), "shape=3"),
        (
            lambda: Architecture(
                {"u": DNF(5), "a": Relay(5), "b": Relay(5)}, ("a", "b"), ("b", "a")
            ),
            r"relays \['a', 'b'\] read each other in a circle",
        ),
        (lambda: Relay(5, "mean"), "combine='mean' is unknown"),
        (lambda: Relay(5, kind="tanh"), "kind='tanh' is unknown"),
        (
            lambda: Architecture(
                {"u": DNF(5)}, Link("u", "u", Projection("c p -> p", (3, 20), 20))
            ),
            r"leads from \[3, 20\] to \[20\], the elements have \[5\] and \[5\]",
        ),
    ],
)
def test_what_is_no_architecture_is_refused_in_one_sentence(build, words):
    with pytest.raises((ValueError, TypeError), match=words) as raised:
        build()
    assert "\n" not in str(raised.value)


def test_one_part_cannot_stand_twice():
    field = DNF(5)
    with pytest.raises(ValueError, match="are one part"):
        Architecture({"u": field, "v": field})


@pytest.mark.parametrize("fold", [False, True])
def test_a_wrong_input_changes_nothing(fold):
    model = coupled(D).fold() if fold else coupled(D)
    before = model.state
    for wrong, words in (
        ({"w": torch.zeros(12)}, "inputs has 'w', which is no element: choose from"),
        ({"u": torch.zeros(11)}, r"u of shape \[11\] does not end in \[12\]"),
        ({"u": torch.zeros(3, 12, dtype=D)}, r"call resize"),
    ):
        with pytest.raises(ValueError, match=words):
            model(wrong)
    assert all(torch.equal(model.state[name], x) for name, x in before.items())

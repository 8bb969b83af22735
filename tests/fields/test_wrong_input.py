"""What is no input, no parameter, no link: one sentence, and nothing has changed."""

import copy
import math
import pickle

import numpy as np
import pytest
import torch
from torch import nn

from dntorch import (
    DNF,
    Architecture,
    Gauss,
    Global,
    Link,
    Matrices,
    MemoryTrace,
    Noise,
    Projection,
    Relay,
    gauss,
    plots,
    rollout,
)
from dntorch.analysis import fixed_points
from dntorch.cells.codes import rate_code
from dntorch.cells.readout import center_of_mass, peaks
from dntorch.export.boundary import Boundary
from dntorch.losses import peak_loss

D = torch.float64
HUGE = 10**400


def one(*links, **how):
    return Architecture({"u": DNF(5)}, *links, **how)


def sentence(run, *args):
    with pytest.raises((ValueError, TypeError)) as raised:
        run(*args)
    text = str(raised.value)
    assert raised.type in (ValueError, TypeError), text
    assert "\n" not in text and ": " in text and len(text) < 400
    return text


WRONG = {
    "inputs is a": [
        lambda: one(inputs="s"), lambda: one(inputs=[3]), lambda: one(inputs=torch.ones(3)),
        lambda: one()(None), lambda: one()(torch.ones(5)), lambda: one().fold()([1.0]),
    ],
    "inputs has the name": [lambda: one(inputs={3: 5}), lambda: one(inputs={"": 5})],
    "inputs['s'] is not finite": [lambda: one(inputs={"s": torch.tensor(math.nan)})],
    "inputs['s'] of dtype": [lambda: one(inputs={"s": torch.ones(5, dtype=torch.complex64)})],
    "inputs['s']=": [lambda: one(inputs={"s": HUGE}), lambda: one(inputs={"s": b"ab"})],
    "order=": [lambda: one(order="u"), lambda: one(order=3), lambda: one(order=[3])],
    "filled=": [lambda: one(order=["u"], filled="no")],
    "source": [lambda: one((["u"], "u")), lambda: one((np.ones(3), "u"))],
    "axes=": [lambda: one(Link("u", "u", 3)), lambda: one(Link("u", "u", DNF(5)))],
    "border=": [
        lambda: one(Link("u", "u", "x -> x", 1.0, "round")),
        lambda: Projection("->", (), (), 1.0, 3),
        lambda: DNF(5, (), border="round"), lambda: gauss(5, 1.0, 1.0, border=None),
        lambda: Noise(5, 1.0, border=np.ones(2)), lambda: peaks(torch.ones(5), border=3),
        lambda: center_of_mass(torch.ones(5), None), lambda: DNF((), (), border="round"),
    ],
    "kernel=": [lambda: Projection("x -> x", 5, 5, HUGE), lambda: Projection("x -> x", 5, 5, 1e39),
                lambda: DNF(5, Gauss(1e39, 1.0)), lambda: DNF((), Global(1e39))],
    "h=": [lambda: DNF(5, h=1e39), lambda: DNF(5, h=HUGE),
           lambda: DNF(5, h=torch.tensor(1e39, dtype=D))],
    "tau of dtype": [lambda: DNF(5, tau=torch.tensor(True))],
    "dt=": [lambda: DNF(5, dt=None), lambda: DNF(5, dt=[1]), lambda: Noise(5, 1.0, dt=0.0),
            lambda: Noise(5, 1.0, dt=-1.0), lambda: plots.space_time(torch.ones(2, 2), math.inf)],
    "dtype=": [lambda: DNF(5, dtype=torch.int64), lambda: MemoryTrace(5, dtype="float64"),
               lambda: Noise(5, 1.0, dtype=torch.complex64),
               lambda: Projection("x -> x", 5, 5, dtype=torch.bool)],
    "frozen=": [lambda: MemoryTrace(5, frozen="no")],
    "shape=": [lambda: Relay(HUGE), lambda: DNF(b"ab"), lambda: gauss(-1, 1.0, 1.0),
               lambda: gauss(None, 1.0, 1.0), lambda: gauss(0, 1.0, 1.0),
               lambda: Noise((2, 2, 2, 2), 1.0)],
    "too many for a matrix": [lambda: DNF(10**6)],
    "sigma": [lambda: Noise(5, 1.0, math.inf), lambda: Noise(5, 1.0, None),
              lambda: Noise(5, 1.0, torch.ones(3)), lambda: gauss(5, 1.0, HUGE),
              lambda: peak_loss(torch.ones(5), torch.tensor(1.0), None)],
    "steepness=": [lambda: Relay(5, steepness=math.nan), lambda: Relay(5, steepness="a")],
    "threshold=": [lambda: Relay(5, threshold=math.inf),
                   lambda: peak_loss(torch.ones(5), torch.tensor(1.0), 2.0, threshold=1e308)],
    "output of dtype": [lambda: Projection("x -> x", 5, 5, Gauss(1.0, 1.0))(torch.ones(5).int())],
    "xi of dtype": [lambda: Noise(5, 1.0)(torch.ones(5, dtype=D))],
    "input of dtype": [lambda: MemoryTrace(5)(torch.ones(5, dtype=torch.bool))],
    "output is a": [lambda: center_of_mass(None)],
    "silent=": [lambda: rate_code(torch.zeros(5), 0.0, 1.0, silent="none")],
    "structure is a": [lambda: rollout(None, torch.ones(3, 5))],
    "inputs has None": [lambda: rollout(DNF(5), None), lambda: rollout(one(), {"u": None})],
    "state": [lambda: rollout(DNF(5), torch.ones(3, 5), "s"), lambda: one().step({}, None),
              lambda: rollout(one(), {"u": torch.ones(3, 5)}, {}), lambda: one().step({}, {})],
    "u of shape [3]": [lambda: one().step({}, {"u": torch.ones(3)})],
    "input=": [lambda: fixed_points(DNF(()), "a"), lambda: fixed_points(DNF(()), None),
               lambda: fixed_points(DNF(()), 1e308)],
    "inputs has 0 entries": [lambda: Boundary(DNF(5)), lambda: Boundary(one())],
    "inputs has 2 entries": [lambda: Boundary(DNF(5), torch.ones(5), torch.ones(5))],
    "structure is a NoneType": [lambda: Boundary(None)],
    "ax is a": [lambda: plots.space_time(torch.ones(2, 2), 0.1, ax=3)],
    "batches": [
        lambda: Architecture({"u": DNF(5, h=-torch.ones(2)), "v": DNF(5, h=-torch.ones(3))}),
        lambda: gauss(5, torch.ones(2), torch.ones(3)),
    ],
    "elements['v'] of dtype": [lambda: Architecture({"u": DNF(5), "v": DNF(5, dtype=D)})],
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "run"), [(words, run) for words, each in WRONG.items() for run in each]
)
def test_it_is_refused_in_one_sentence(words, run):
    assert words in sentence(run)


def test_a_refused_kernel_leaves_the_one_before():
    x = torch.rand(5)
    cases = [
        (Projection("x -> x", 5, 5, 2.0), "none"),
        (Projection("x -> x", 5, 4, Matrices((torch.rand(4, 5),))), 2.0),
        (Projection("x -> x", 5, 5, Gauss(1.0, 1.0)), math.inf),
        (DNF(5, Gauss(1.0, 1.0)), Gauss(1e39, 1.0)),
    ]
    for holder, wrong in cases:
        before, kernel = holder(x), holder.kernel
        sentence(setattr, holder, "kernel", wrong)
        assert holder.kernel is kernel
        if isinstance(holder, Projection):
            assert torch.equal(holder(x), before)


def test_a_refused_architecture_leaves_its_parts_as_they_were():
    field = DNF(5, dtype=D)
    field.u.fill_(3.0)
    for other in (DNF(5), DNF(5, dt=0.01, dtype=D)):
        sentence(Architecture, {"v": other, "u": field})
    assert field.u.dtype == D and (field.u == 3).all()


def test_a_parameter_as_kernel_is_learned():
    gain = nn.Parameter(torch.tensor(2.0))
    projection = Projection("x -> x", 5, 5, gain)
    assert dict(projection.named_parameters()) == {"everywhere": gain}
    optimizer = torch.optim.SGD(projection.parameters(), 0.1)
    projection(torch.ones(5)).sum().backward()
    optimizer.step()
    assert torch.equal(projection(torch.ones(5)), torch.full((5,), 1.5))
    assert projection.kernel is gain
    projection.kernel = nn.Parameter(torch.tensor(4.0))
    assert torch.equal(projection(torch.ones(5)), torch.full((5,), 4.0))
    projection.kernel = 1.0
    assert not list(projection.parameters())
    sentence(setattr, DNF(5), "kernel", nn.Parameter(torch.tensor(4.0)))


@pytest.mark.parametrize("kernel", [
    lambda a: a, lambda a: (Gauss(a, 1.0), Global(a)), lambda a: a.reshape(1, 1)])  # fmt: skip
def test_what_wants_a_gradient_is_copied_and_pickled(kernel):
    a = torch.tensor(2.0, requires_grad=True)
    model = one(("u", "u", kernel(a)))
    expected = model({"u": torch.ones(5)})["u"]
    assert expected.shape == (5,)
    for again in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        again.reset()
        assert torch.equal(again({"u": torch.ones(5)})["u"], expected)


def test_a_gain_that_was_overwritten_reads_as_a_gain():
    projection, other = (Projection("x -> x", 5, 5, k) for k in (2.0, 1.0))
    projection.everywhere.fill_(3.0)
    assert projection.kernel == 3.0
    other.kernel = projection.kernel
    assert torch.equal(other(torch.arange(5.0)), 3 * torch.arange(5.0))


def test_tensors_of_a_kernel_or_a_stimulus_are_checked_when_they_are_set():
    field = DNF(5)
    for name, wrong in (
        ("kernel_0", 3), ("kernel_0", torch.zeros(1, 3, 3)), ("kernel_0", None),
        ("kernel_0", nn.Parameter(torch.full((1, 5, 5), math.nan))), ("everywhere", torch.ones(1)),
    ):  # fmt: skip
        assert name in sentence(setattr, field, name, wrong)
    field.kernel_0 = nn.Parameter(torch.zeros(2, 5, 5))
    assert "kernel_0" in field.state_dict()
    model = one(("s", "u"), inputs={"s": 5})
    for wrong in (3, torch.ones(4), torch.full((5,), math.nan)):
        assert "value" in sentence(setattr, model["s"], "value", wrong)
    model["s"].value = torch.ones(5, dtype=torch.int64)
    assert model["s"].value.dtype == torch.float32


def test_a_stimulus_of_whole_numbers_is_a_stimulus():
    for dtype in (torch.int64, torch.bool, torch.uint8):
        model = one(("s", "u", Gauss(1.0, 1.0)), inputs={"s": torch.ones(5, dtype=dtype)})
        same = one(("s", "u", Gauss(1.0, 1.0)), inputs={"s": torch.ones(5)})
        for _ in range(3):
            assert torch.equal(model({})["u"], same({})["u"])


def test_a_relay_is_checked_when_it_is_set():
    relay = Relay(2, kind="logistic")
    for name, wrong in (("steepness", math.nan), ("kind", "tanh"), ("combine", "product"),
                        ("shape", 3), ("threshold", "a")):  # fmt: skip
        assert name in sentence(setattr, relay, name, wrong)
    relay.kind = "heaviside"
    assert relay(torch.tensor([-1.0, 1.0])).tolist() == [0.0, 1.0]


def test_a_batch_without_members_has_numbers_without_members():
    field = DNF(5, tau=torch.ones(0), h=-torch.ones(0))
    assert field(torch.ones(0, 5)).shape == (0, 5)
    assert gauss(5, 1.0, torch.ones(0)).shape == (0, 5)


def test_gauss_maps_over_its_width():
    sigma = torch.tensor([1.0, 2.0])
    rows = torch.func.vmap(lambda s: gauss(5, 1.0, s))(sigma)
    torch.testing.assert_close(rows, gauss(5, 1.0, sigma))


def test_no_fixed_point_is_missed_for_a_large_input():
    ((u, stable),) = fixed_points(DNF((), Global(6.0)), 1e30)
    assert u == pytest.approx(1e30) and stable
    assert len(fixed_points(DNF((), Global(6.0)), [0.0, 2.0])) == 2


def test_a_code_of_what_is_not_finite_is_no_number():
    assert rate_code(torch.tensor([math.inf, 1.0, 0.0]), 0.0, 1.0).isnan()

"""Output functions against closed forms."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dntorch.cells.functions import (
    abs_sigmoid,
    came_on,
    heaviside,
    is_on,
    logistic,
    rectified,
    sigmoid,
)

SMOOTH = [abs_sigmoid, logistic]
number = st.floats(-1e3, 1e3)
slope = st.floats(1e-2, 1e3)


def f64(x: float) -> torch.Tensor:
    return torch.tensor(x, dtype=torch.float64)


@pytest.mark.parametrize("f", SMOOTH)
@given(u=number, steepness=slope, threshold=number)
def test_sigmoids_stay_between_zero_and_one(f, u, steepness, threshold):
    assert 0 <= f(f64(u), steepness, threshold) <= 1


@pytest.mark.parametrize("f", SMOOTH)
@given(distance=number, steepness=slope, threshold=st.floats(-10, 10))
def test_sigmoids_are_symmetric_about_the_threshold(f, distance, steepness, threshold):
    above = f(f64(threshold + distance), steepness, threshold)
    below = f(f64(threshold - distance), steepness, threshold)
    assert above + below == pytest.approx(1, abs=1e-8)
    assert f(f64(threshold), steepness, threshold) == 0.5


@pytest.mark.parametrize("f", SMOOTH)
def test_sigmoids_rise(f):
    u = torch.linspace(-5, 5, 1001, dtype=torch.float64)
    assert (f(u, 3.0, 0.5).diff() > 0).all()


@pytest.mark.parametrize(("f", "factor"), [(abs_sigmoid, 1 / 2), (logistic, 1 / 4)])
@pytest.mark.parametrize("steepness", [1.0, 4.0, 100.0])
def test_slope_at_the_threshold(f, factor, steepness):
    u = f64(0.3).requires_grad_()
    f(u, steepness, 0.3).backward()
    assert u.grad == pytest.approx(factor * steepness)


@pytest.mark.parametrize("f", SMOOTH)
def test_gradients_agree_with_differences(f):
    u = torch.tensor([-2.0, -0.1, 0.7, 3.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda u: f(u, 4.0, 0.2), u)


@given(u=number)
def test_logistic_closed_form(u):
    exponent = -2 * (u - 1)
    expected = 1 / (1 + math.exp(exponent)) if exponent < 700 else 0.0
    assert logistic(f64(u), 2.0, 1.0) == pytest.approx(expected, abs=1e-15)


def test_abs_sigmoid_is_no_fast_logistic():
    u = torch.linspace(-20, 20, 40_001, dtype=torch.float64)
    difference = (abs_sigmoid(u, 1.0, 0.0) - logistic(u, 1.0, 0.0)).abs().max()
    assert difference == pytest.approx(0.082, abs=5e-4)


def test_abs_sigmoid_has_an_algebraic_tail():
    assert abs_sigmoid(f64(-5.0), 100.0, 0.0) == pytest.approx(1e-3, rel=3e-3)
    tenfold = abs_sigmoid(f64(-500.0), 100.0, 0.0) / abs_sigmoid(f64(-50.0), 100.0, 0.0)
    assert tenfold == pytest.approx(0.1, rel=1e-3)


def test_heaviside_and_rectified_jump_just_above_the_threshold():
    u = torch.tensor([-1.0, 0.5, 0.5001, 2.0])
    assert heaviside(u, 0.5).tolist() == [0, 0, 1, 1]
    assert heaviside(u.double(), 0.5).dtype == torch.float64
    assert torch.equal(rectified(u, 0.5), torch.tensor([0, 0, 0.5001, 2.0]))


@pytest.mark.parametrize("kind", ["abs", "logistic", "heaviside"])
def test_steep_sigmoids_tend_to_the_step(kind):
    u = torch.tensor([-1.0, -0.1, 0.1, 1.0], dtype=torch.float64)
    assert sigmoid(u, kind, 1e6, 0.0).round(decimals=4).tolist() == [0, 0, 1, 1]


def test_unknown_sigmoid_names_the_known_ones():
    with pytest.raises(
        ValueError, match=r"tanh.* choose 'abs', 'logistic', 'heaviside', 'semilinear' or 'linear'"
    ):
        sigmoid(torch.zeros(1), "tanh", 1.0, 0.0)


@pytest.mark.parametrize("convert", [lambda x: x, torch.Tensor.numpy], ids=["torch", "numpy"])
def test_a_node_comes_on_when_its_rate_crosses_one_half(convert):
    rates = torch.tensor([0.0, 0.5, 0.5001, 1.0])
    before, after = (convert(part) for part in torch.meshgrid(rates, rates, indexing="ij"))
    assert is_on(after)[0].tolist() == [False, False, True, True]
    off_before = [[False, False, True, True]] * 2
    assert came_on(before, after).tolist() == off_before + [[False] * 4] * 2


def test_came_on_scripts():
    before, after = torch.rand(2, 3, 4)
    assert torch.equal(torch.jit.script(came_on)(before, after), came_on(before, after))

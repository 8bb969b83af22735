"""Kernels against loops, SciPy's filters and invariants."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from dntorch.cells.field import lateral
from dntorch.cells.kernels import Gauss, Global, Matrices, assemble, gauss_matrix

BORDERS = pytest.mark.parametrize("border", ["circular", "zero"])
MODE = {"circular": "wrap", "zero": "constant"}


def apply(kernel, output, border="circular"):
    return lateral(output, *assemble(kernel, list(output.shape), border))


def random(*shape):
    return torch.rand(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(7))


@BORDERS
@settings(max_examples=40)
@given(
    n=st.integers(1, 12),
    sigma=st.floats(0.3, 8),
    shift=st.integers(-4, 4),
    cutoff=st.floats(0.5, 5),
)
def test_matrix_is_the_definition_written_as_a_loop(border, n, sigma, shift, cutoff):
    matrix = gauss_matrix(n, sigma, border, shift, cutoff, normalized=False)
    for to in range(n):
        for source in range(n):
            distances = [to - source - shift]
            if border == "circular":
                distances = [distances[0] + turn * n for turn in range(-20, 20)]
            distance = min(map(abs, distances))
            near = distance <= math.ceil(cutoff * sigma)
            expected = math.exp(-(distance**2) / (2 * sigma**2)) if near else 0
            assert matrix[to, source] == pytest.approx(expected, abs=1e-12)


@BORDERS
@pytest.mark.parametrize("shape", [(51,), (40, 33), (19, 22, 17)])
def test_lateral_agrees_with_scipy_in_any_dimension(border, shape):
    output, sigma = random(*shape), (1.7, 1.2, 0.9)[: len(shape)]
    expected = ndimage.gaussian_filter(output.numpy(), sigma, mode=MODE[border], radius=[
        math.ceil(5 * s) for s in sigma
    ])  # fmt: skip
    torch.testing.assert_close(
        apply([Gauss(3.0, sigma)], output, border), 3 * torch.from_numpy(expected)
    )


def test_borders_can_differ_between_axes():
    output = random(30, 40)
    expected = ndimage.gaussian_filter(output.numpy(), 2.0, mode=["wrap", "constant"], truncate=5)
    actual = apply([Gauss(1.0, 2.0)], output, ("circular", "zero"))
    torch.testing.assert_close(actual, torch.from_numpy(expected))


@settings(max_examples=40)
@given(
    n=st.integers(1, 60),
    sigma=st.floats(0.2, 30),
    shift=st.integers(-280, 280).map(lambda k: k / 4),  # exact: no tap on the very edge
    cutoff=st.floats(1, 6),
)
def test_circular_rows_sum_to_one_and_are_rotations(n, sigma, shift, cutoff):
    matrix = gauss_matrix(n, sigma, "circular", shift, cutoff)
    ones = torch.ones(n, dtype=torch.float64)
    torch.testing.assert_close(matrix.sum(0), ones)
    torch.testing.assert_close(matrix.sum(1), ones)
    torch.testing.assert_close(matrix, matrix.roll((1, 1), (0, 1)))


def test_zero_border_loses_what_reaches_over_the_edge():
    rows = gauss_matrix(51, 3.0, "zero").sum(1)
    torch.testing.assert_close(rows[15:36], torch.ones(21, dtype=torch.float64))
    assert rows[0] < rows[1] < rows[10] < 1
    assert rows[0] == pytest.approx((1 + gauss_matrix(51, 3.0)[0, 0]) / 2)  # half, and the middle


@pytest.mark.parametrize("cutoff", [1.0, 2.5, 5.0])
def test_cutoff_is_a_half_width_in_sigmas(cutoff):
    taps = (gauss_matrix(101, 4.0, "zero", cutoff=cutoff)[50] > 0).sum()
    assert taps == 2 * math.ceil(cutoff * 4) + 1


def test_kernel_wider_than_a_ring_goes_around_once():
    row = gauss_matrix(10, 100.0)[0]
    assert (row > 0).all() and row == pytest.approx(torch.full((10,), 0.1), abs=1e-3)


@BORDERS
def test_shift_moves_the_effect_to_the_right(border):
    delta = torch.zeros(51, dtype=torch.float64)
    delta[20] = 1
    assert apply([Gauss(1.0, 2.0, shift=3.0)], delta, border).argmax() == 23


def test_unnormalized_amplitude_is_the_height():
    delta = torch.zeros(21, 21, dtype=torch.float64)
    delta[10, 10] = 1
    assert apply([Gauss(7.0, 2.0, normalized=False)], delta).max() == pytest.approx(7)


@pytest.mark.parametrize("shape", [(9,), (5, 6), (3, 4, 5)])
def test_terms_add_up_in_any_order(shape):
    output = random(2, *shape)
    terms = [Gauss(4.0, 1.0), Gauss(-2.0, 2.0), Global(-0.3)]
    stack = lambda kernel: lateral(output, *assemble(kernel, list(shape), "circular"))  # noqa: E731
    one_by_one = sum(stack([term]) for term in terms)
    torch.testing.assert_close(stack(terms), one_by_one)
    torch.testing.assert_close(stack(terms[::-1]), one_by_one)
    per_row = output.flatten(1).sum(1).view(2, *[1] * len(shape)).expand_as(output)
    torch.testing.assert_close(stack([Global(2.0)]), 2 * per_row)


def test_without_axes_every_term_is_a_factor():
    assert apply([Gauss(10.0, 3.0), Global(-4.0)], torch.tensor(0.5)) == 3


def test_given_matrices_act_as_to_from():
    rows, columns, output = random(4, 4), random(5, 5), random(4, 5)
    actual = apply([Matrices((rows, columns))], output)
    torch.testing.assert_close(actual, torch.einsum("ab,cd,bd->ac", rows, columns, output))


@pytest.mark.parametrize(
    ("kernel", "border", "message"),
    [
        ([Gauss(1.0, -1.0)], "zero", "sigma=-1.0"),
        ([Gauss(1.0, 1.0)], "mirror", "border='mirror'.*'circular' or 'zero'"),
        ([Gauss(1.0, (1.0, 2.0, 3.0))], "zero", "sigma=.* 3 entries for 2 axes"),
        ([Gauss(1.0, 1.0)], ("zero",), "border=.* 1 entries for 2 axes"),
        ([Matrices((torch.eye(4),))], "zero", r"matrices of \[\[4, 4\]\] do not fit"),
    ],
)
def test_wrong_kernels_name_what_is_wrong(kernel, border, message):
    with pytest.raises(ValueError, match=message):
        assemble(kernel, [4, 5], border)

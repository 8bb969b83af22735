"""Projections: every pattern is what a loop says, its transpose is the adjoint."""

import itertools

import pytest
import torch

from dntorch import Gauss, Global, Matrices, Projection

D = torch.float64
TERMS = (Gauss(2.0, 1.0, shift=0.4), Global(-0.3))
PATTERNS = [
    ("x -> x", 7, 7, 1.5), ("x -> x", 7, 7, TERMS), ("x -> x", 7, 3, "matrices"),
    ("y x -> x", (4, 7), 7, TERMS), ("y x -> y", (4, 7), 4, 0.5), ("x -> y x", 7, (4, 7), TERMS),
    ("y x -> x y", (4, 7), (7, 4), TERMS), ("y x -> y x", (4, 7), (4, 7), TERMS),
    ("x ->", 7, (), 2.0), ("-> x", (), 7, 2.0), ("x -> y", 7, 3, 2.0),
    ("r g -> r+g", (4, 7), 10, TERMS), ("r+g -> r g", 10, (4, 7), TERMS),
    ("r+g -> g r", 10, (7, 4), 1.0), ("c r+g -> r c g", (3, 10), (4, 3, 7), TERMS),
    ("r c g -> c r+g", (4, 3, 7), (3, 10), TERMS),
    ("a b c -> c a b", (2, 3, 4), (4, 2, 3), TERMS),
    ("a b c -> d c a", (2, 3, 4), (5, 4, 2), TERMS),
]  # fmt: skip
each = pytest.mark.parametrize(("axes", "source", "target", "kernel"), PATTERNS, ids=str)


def built(axes, source, target, kernel, **how):
    if kernel == "matrices":
        kernel = Matrices((torch.linspace(-1, 1, source * target).reshape(target, source),))
    return Projection(axes, source, target, kernel, border="zero", dtype=D, **how)


def noise(*shape):
    return torch.randn(shape, dtype=D, generator=torch.Generator().manual_seed(3))


@each
def test_its_transpose_is_the_adjoint(axes, source, target, kernel):
    forth = built(axes, source, target, kernel)
    back = forth.transpose()
    x, y = noise(5, *forth.source), noise(5, *forth.target)
    for k in range(5):
        torch.testing.assert_close((forth(x[k]) * y[k]).sum(), (x[k] * back(y[k])).sum())
    torch.testing.assert_close(back.transpose()(x), forth(x))


@each
def test_a_row_of_a_batch_is_the_run_alone_and_it_scripts(axes, source, target, kernel):
    projection = built(axes, source, target, kernel)
    x = noise(2, 3, *projection.source)
    whole = projection(x)
    assert list(whole.shape) == [2, 3, *projection.target]
    for k, m in itertools.product(range(2), range(3)):
        torch.testing.assert_close(whole[k, m], projection(x[k, m]), rtol=1e-13, atol=1e-13)
    assert torch.equal(torch.jit.script(projection)(x), whole)


@each
def test_gradients_are_those_of_finite_differences(axes, source, target, kernel):
    projection = built(axes, source, target, kernel)
    x = noise(*projection.source).requires_grad_()
    assert torch.autograd.gradcheck(projection, (x,))


def loop(axes, x, target, reduce):
    """What a pattern with a gain of one says, site by site."""
    came, goes = (side.split() for side in axes.split("->"))
    found: dict[tuple, list] = {place: [] for place in itertools.product(*map(range, target))}
    for place in itertools.product(*map(range, x.shape)):
        at = dict(zip(came, place))
        for name in goes:
            if "+" in name and name not in at:
                at[name] = sum(at[part] for part in name.split("+"))
        for to in found:
            known = dict(zip(goes, to))
            for name in came:
                if "+" in name and name not in known:
                    known[name] = sum(known[part] for part in name.split("+"))
            if all(at[name] == known[name] for name in at.keys() & known.keys()):
                found[to].append(float(x[place]))
    how = {"sum": sum, "max": max, "min": min, "mean": lambda each: sum(each) / len(each)}
    return torch.tensor([how[reduce](v) for v in found.values()], dtype=D).reshape(target)


@pytest.mark.parametrize("reduce", ["sum", "mean", "max", "min"])
@pytest.mark.parametrize(
    ("axes", "source", "target"),
    [pattern[:3] for pattern in PATTERNS if pattern[3] != "matrices"],
    ids=str,
)
def test_it_is_the_loop_over_sites(axes, source, target, reduce):
    projection = Projection(axes, source, target, reduce=reduce, dtype=D)
    x = noise(*projection.source)
    expected = loop(axes, x, tuple(projection.target), reduce)
    torch.testing.assert_close(projection(x), expected)


def test_a_kernel_acts_on_the_axes_that_go_through():
    x = noise(4, 7)
    kernel = (Gauss(2.0, 1.0), Global(-0.3))
    alone = Projection("x -> x", 7, 7, kernel, dtype=D)
    reduced = Projection("y x -> x", (4, 7), 7, kernel, dtype=D)
    torch.testing.assert_close(reduced(x), alone(x.sum(0)))


def test_a_kernel_is_set_and_learned():
    gain = torch.tensor(2.0, requires_grad=True)
    projection = Projection("x -> x", 5, 5)
    projection.kernel = gain
    projection(torch.ones(5)).sum().backward()
    assert gain.grad == 5
    projection.kernel = (Gauss(gain, 1.0),)
    (slope,) = torch.autograd.grad(projection(torch.ones(5)).sum(), gain)
    torch.testing.assert_close(slope, torch.tensor(5.0))
    assert projection.kernel == (Gauss(gain, 1.0),)
    projection.kernel = 3.0
    assert projection.kernel == 3.0
    assert torch.equal(projection(torch.ones(5)), torch.full((5,), 3.0))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("x", 5, 5), "axes='x' is no pattern"),
        ((3, 5, 5), "axes=3 is no pattern"),
        (("x x -> x", (5, 5), 5), "name of its own"),
        (("x y -> x", 5, 5), "names 2 axes of the source, which has shape"),
        (("x -> x", 5, 6), r"sizes \[5\] become \[6\]: give Matrices"),
        (("x -> x", 5, 6, Gauss(1.0, 1.0)), r"sizes \[5\] become \[6\]: give Matrices"),
        (("x -> x", 5, 6, Matrices((torch.ones(5, 6),))), r"give \[\[6, 5\]\]"),
        (("x -> y", 5, 6, Matrices((torch.ones(6, 5),))), "alike on both sides"),
        (("r g -> r+g", (4, 7), 11), "r.g of 11 sites does not fit 4 and 7: give 10"),
        (("r+g -> r g", 11, (4, 7)), "r.g of 11 sites does not fit 4 and 7: give 10"),
        (("r+g -> r x", 10, (4, 7)), "must stand on the other side"),
        (("a b c d -> a b c d", (2,) * 4, (2,) * 4), "more than three axes"),
        (("x -> x", 5, 5, 1.0, "circular", "median"), "reduce='median' is unknown"),
        (("x -> x", 5, 5, float("nan")), "kernel=nan is no gain"),
        (("x -> x", 5, 5, Gauss(1.0, -1.0)), "sigma=-1.0 is negative"),
        (("x -> x", 0, 5), "source=0: give a number of sites"),
    ],
    ids=str,
)
def test_what_is_no_projection_is_refused_in_one_sentence(arguments, words):
    with pytest.raises(ValueError, match=words) as raised:
        Projection(*arguments)
    assert "\n" not in str(raised.value)


def test_a_wrong_input_is_refused():
    with pytest.raises(ValueError, match=r"output of shape \[6\] does not end in \[5\]"):
        Projection("x -> x", 5, 5)(torch.zeros(6))
    with pytest.raises(ValueError, match="reduce='max' has no adjoint"):
        Projection("y x -> x", (4, 5), 5, reduce="max").transpose()

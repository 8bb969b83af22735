"""Losses that teach a field where its peaks shall be."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.autograd import gradcheck

from dntorch import DNF, losses, peaks, space_code
from dntorch.losses import no_peak_loss, peak_loss

LINES = torch.randn(3, 30, generator=torch.Generator().manual_seed(0)).double()
SHEETS = torch.randn(2, 8, 9, generator=torch.Generator().manual_seed(1)).double()
TORUS = ("circular", "circular")


def run(field, input, steps=64):
    state = field.initial(list(input.shape[:-1]))
    for _ in range(steps):
        _, state = field.step(input, state)
    return state.u


def test_they_order_fields_as_one_would():
    field = DNF(60)

    def at(*places, amplitude=8.0):
        stimuli = space_code(torch.tensor(places), 60, 0.0, 60.0, 3.0, amplitude=amplitude)
        return run(field, stimuli.sum(0))

    near, off, silent = at(20.5), at(45.0), at(20.0, amplitude=1.0)
    both = at(20.5).maximum(at(45.0))
    assert peaks(both).count == 2
    loss = [peak_loss(u, torch.tensor(20.5), 3.0) for u in (near, silent, both, off)]
    assert loss[0] < math.log(2) < loss[1] < loss[3] and loss[2] > math.log(2)
    assert no_peak_loss(silent) < 0.02 < 1 < no_peak_loss(near)
    wide = peak_loss(near, torch.tensor(50.0), 3.0, threshold=-10.0)
    assert wide > peak_loss(near, torch.tensor(50.0), 3.0)  # all of it is above -10


def test_they_are_log_2_at_the_threshold_for_any_size():
    for shape, border in (((9,), "zero"), ((300,), "circular"), ((20, 30), TORUS)):
        u = torch.full(shape, 1.5).double()
        position = torch.full((len(shape),), 2.0).double() if len(shape) > 1 else torch.tensor(2.0)
        assert no_peak_loss(u, border, 1.5).item() == pytest.approx(math.log(2))
        both = peak_loss(u, position, 1.0, border, 1.5).item()
        assert both == pytest.approx(2 * math.log(2))
    # A tolerance that covers the field leaves no site to be off.
    assert peak_loss(torch.zeros(5), torch.tensor(2.0), 9.0).item() == pytest.approx(math.log(2))


@given(st.integers(-40, 40), st.floats(0, 29), st.integers(0, 99))
def test_they_move_with_the_field(shift, place, seed):
    u = torch.randn(30, generator=torch.Generator().manual_seed(seed)).double()
    place = torch.tensor(place).double()
    moved = peak_loss(u.roll(shift), place + shift, 2.0)
    torch.testing.assert_close(moved, peak_loss(u, place, 2.0))
    torch.testing.assert_close(no_peak_loss(u.roll(shift)), no_peak_loss(u), rtol=0, atol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_row_is_a_single_run_and_reductions_are_over_the_batch(dtype):
    u, place = LINES.to(dtype), torch.tensor([3.0, 14.5, 29.0], dtype=dtype)
    rows = peak_loss(u, place, 2.0, reduction="none")
    assert rows.shape == (3,) and rows.dtype == dtype
    assert torch.equal(rows, torch.stack([peak_loss(a, b, 2.0) for a, b in zip(u, place)]))
    torch.testing.assert_close(peak_loss(u, place, 2.0), rows.mean())
    torch.testing.assert_close(peak_loss(u, place, 2.0, reduction="sum"), rows.sum())
    one = peak_loss(u, place[1], 2.0, reduction="none")  # a position for all
    torch.testing.assert_close(one[1], rows[1])
    sheets, places = SHEETS.to(dtype), torch.tensor([[1.0, 2.0], [7.5, 8.5]], dtype=dtype)
    rows = peak_loss(sheets, places, (1.0, 1.5), TORUS, reduction="none")
    pairs = zip(sheets, places)
    assert torch.equal(rows, torch.stack([peak_loss(a, b, (1.0, 1.5), TORUS) for a, b in pairs]))
    assert no_peak_loss(sheets, TORUS, reduction="none").shape == (2,)


def test_gradients_are_right():
    place = torch.tensor([3.2, 14.1, 28.3]).double()
    inputs = LINES.clone().requires_grad_(), place.requires_grad_()
    gradcheck(lambda u, p: peak_loss(u, p, 2.0, "circular", reduction="none"), inputs)
    gradcheck(lambda u, p: peak_loss(u, p, 2.0, "zero", reduction="none"), inputs)
    places = torch.tensor([[1.0, 2.0], [6.5, 7.5]]).double()
    sheets = SHEETS.clone().requires_grad_()
    gradcheck(lambda u: peak_loss(u, places, 1.0, ("circular", "zero")), sheets)
    gradcheck(lambda u: no_peak_loss(u, TORUS, reduction="none"), sheets)


def test_a_silent_field_has_a_gradient_where_its_peak_is_missing():
    u = torch.full((51,), -80.0, requires_grad=True)  # an output of exactly zero
    peak_loss(u, torch.tensor(20.0), 2.0).backward()
    assert u.grad.isfinite().all() and u.grad.argmin() == 20 and u.grad.sum() < -0.9
    on = torch.full((51,), 80.0, requires_grad=True)
    no_peak_loss(on).backward()
    assert on.grad.sum().item() == pytest.approx(1)


def test_a_silent_field_learns_to_make_a_peak_and_to_lose_it():
    """Through two seconds of a field, from an input that is too weak; then back."""
    field, place = DNF(40), torch.tensor([8.0, 31.0])
    strength = torch.tensor(1.0, requires_grad=True)
    optimizer = torch.optim.Adam([strength], lr=0.3)
    bumps = space_code(place, 40, 0.0, 40.0, 3.0)
    assert peaks(run(field, strength * bumps)).count.tolist() == [0, 0]
    for loss, count in ((lambda u: peak_loss(u, place, 3.0), 1), (no_peak_loss, 0)):
        for _ in range(40):
            value = loss(run(field, strength * bumps, 24))
            optimizer.zero_grad()
            value.backward()
            optimizer.step()
        found = peaks(run(field, strength.detach() * bumps))
        assert found.count.tolist() == [count, count]
        if count:
            torch.testing.assert_close(found.center.flatten(), place, atol=0.1, rtol=0)


def test_they_compile_and_vmap():
    place = torch.tensor([3.0, 14.5, 29.0]).double()
    rows = peak_loss(LINES, place, 2.0, reduction="none")
    each = torch.vmap(lambda u, p: peak_loss(u, p, 2.0))
    torch.testing.assert_close(each(LINES, place), rows)
    compiled = torch.compile(peak_loss, fullgraph=True, backend="eager")
    torch.testing.assert_close(compiled(LINES, place, 2.0, reduction="none"), rows)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sigma": -1.0}, "sigma=-1.0 is less than one site: give at least 1"),
        ({"sigma": math.nan}, "sigma=nan is less than one site"),
        ({"sigma": (1.0, 2.0)}, "sigma=.* has 2 entries for 1 axes"),
        ({"reduction": "average"}, "reduction='average' is unknown: choose 'mean', 'sum' or"),
        ({"threshold": math.inf}, "threshold=inf is not finite"),
        ({"border": "zero", "position": torch.tensor(99.0)}, "position=99.0 is out of range: give"),
        ({"position": torch.tensor(math.nan)}, "position has 1 NaN of 1"),
        ({"position": torch.zeros(4)}, r"position of shape \[4\] does not fit \[3\]"),
        ({"u": torch.full((3, 5), math.nan)}, "u has 15 NaN of 15"),
        ({"u": torch.tensor(1.0)}, r"u of shape \[\] is no field of 1 axes"),
    ],
)
def test_they_refuse_in_one_sentence(change, words):
    good = {"u": torch.zeros(3, 5), "position": torch.tensor(2.0), "sigma": 1.0}
    with pytest.raises(ValueError, match=words):
        losses.peak_loss(**good | change)
    shared = {k: v for k, v in change.items() if k in ("u", "reduction", "threshold")}
    if shared:
        with pytest.raises(ValueError, match=words):
            losses.no_peak_loss(**{"u": good["u"]} | shared)


def test_they_refuse_what_is_no_tensor():
    with pytest.raises(TypeError, match="u is a list: give a tensor"):
        no_peak_loss([1.0])
    with pytest.raises(TypeError, match=r"position of dtype torch.int64 has no floats"):
        peak_loss(torch.zeros(5), torch.tensor(2), 1.0)

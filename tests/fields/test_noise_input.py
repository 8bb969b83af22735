"""Noise of a known spread; traces and stimuli that do not depend on the time step."""

import math

import pytest
import torch

from dntorch import DNF, MemoryTrace, Noise, gauss, rollout

D = torch.float64


@pytest.mark.parametrize("sigma", [0.0, 3.0])
@pytest.mark.parametrize("border", ["circular", "zero"])
@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("rate", [16, 32, 64, 256])
def test_a_resting_field_has_the_spread_it_was_given(rate, substeps, border, sigma):
    """Its response to one impulse of noise, squared and summed, is the variance at each site."""
    n, dt, tau, sd = 41, 1 / rate, 0.1, 0.7
    field = DNF(n, (), tau=tau, dt=dt, substeps=substeps, dtype=D)
    noise = Noise(n, sd, sigma, border, tau=tau, dt=dt, substeps=substeps, dtype=D)
    steps = math.ceil(20 * tau / dt)
    xi = torch.zeros(steps, n, n, dtype=D)
    xi[0] = torch.eye(n, dtype=D)  # row k: an impulse at site k
    field.resize(n)
    _, states = rollout(field, noise(xi))
    variance = (states.u - field.h).square().sum((0, 1))
    torch.testing.assert_close(variance.sqrt(), torch.full((n,), sd, dtype=D), rtol=1e-6, atol=0)


def test_drawn_noise_has_the_spread_too():
    field, noise = DNF(200, (), dt=1 / 16), Noise(200, 0.5, 2.0, dt=1 / 16)
    field.resize(500)
    generator = torch.Generator().manual_seed(0)
    for _ in range(32):
        field(noise(torch.randn(500, 200, generator=generator)))
    assert float((field.u + 5).square().mean().sqrt()) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("rate", [16, 32, 64, 256])
@pytest.mark.parametrize("frozen", [True, False])
def test_a_trace_is_the_same_after_one_second(rate, frozen):
    trace = MemoryTrace(3, 0.5, 2.0, frozen=frozen, dt=1 / rate, dtype=D)
    on = torch.tensor([1.0, 0.0, 0.8], dtype=D)
    trace.trace.copy_(torch.tensor([0.0, 1.0, 0.1]))
    for _ in range(rate):
        output = trace(on)
    grown = 1 - math.exp(-2)
    start = torch.tensor(0.1, dtype=torch.float32).double()
    expected = [grown, math.exp(-0.5), 0.8 * grown + float(start) * math.exp(-2)]
    torch.testing.assert_close(output, torch.tensor(expected, dtype=D), rtol=0, atol=1e-6)
    for _ in range(rate):
        silent = trace(torch.zeros(3, dtype=D))
    faded = output if frozen else output * math.exp(-0.5)
    torch.testing.assert_close(silent, faded, rtol=0, atol=1e-6)


def test_a_trace_is_long_term_memory():
    trace = MemoryTrace(3)
    trace.spread(2)
    trace(torch.eye(3)[:2])
    held = trace.trace.clone()
    trace.reset()
    assert torch.equal(trace.trace, held) and (held[0, 0] > 0) and (held[1, 0] == 0)
    assert torch.equal(trace.select(1).trace, held[1])
    trace.forget()
    assert not trace.trace.any()


def test_gauss_is_the_formula_and_goes_around_the_ring():
    site = torch.arange(7, dtype=D)
    distance = (site - 6.0 + 3.5) % 7 - 3.5
    ring = gauss(7, torch.tensor(6.0, dtype=D), 1.5, 2.0)
    torch.testing.assert_close(ring, 2 * torch.exp(-(distance**2) / 4.5))
    line = gauss(7, torch.tensor(6.0, dtype=D), 1.5, 2.0, "zero")
    torch.testing.assert_close(line, 2 * torch.exp(-((site - 6) ** 2) / 4.5))
    sheet = gauss((4, 7), (1.0, 6.0), (0.5, 1.5), border=("zero", "circular"))
    row = gauss(4, 1.0, 0.5, border="zero")
    torch.testing.assert_close(sheet, row[:, None] * gauss(7, 6.0, 1.5))


def test_gauss_takes_a_batch_and_gives_gradients():
    position = torch.tensor([1.0, 2.5], dtype=D, requires_grad=True)
    sigma = torch.tensor([1.0, 2.0], dtype=D, requires_grad=True)
    both = gauss(6, position, sigma, 3.0)
    assert both.shape == (2, 6)
    torch.testing.assert_close(both[1], gauss(6, position[1], sigma[1], 3.0))
    assert torch.autograd.gradcheck(lambda p, s: gauss(6, p, s, p, "zero"), (position, sigma))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: gauss(5, 1.0, 0.0), "sigma=0.0 must be positive"),
        (lambda: gauss(5, 1.0, torch.tensor([1.0, -1.0])), "sigma=.* must be positive"),
        (lambda: gauss(5, math.nan, 1.0), "position=nan is not finite"),
        (lambda: gauss(5, "1", 1.0), "position='1' is no number"),
        (lambda: gauss(5, 1.0, 1.0, border="mirror"), "border='mirror' is unknown"),
        (lambda: gauss((5, 5), (1.0, 2.0, 3.0), 1.0), "position=.* 3 entries for 2 axes"),
        (lambda: gauss((), 1.0, 1.0), "is a node"),
        (lambda: Noise(5, -1.0), "sd=-1.0 is negative"),
        (lambda: Noise(5, 1.0, sigma=-1.0), "sigma=-1.0 is negative"),
        (lambda: Noise(5, 1.0, tau=0.01), "dt=0.03125 is longer than tau=0.01"),
        (lambda: Noise(5, 1.0)(torch.zeros(4)), r"xi of shape \[4\] does not end in \[5\]"),
        (lambda: MemoryTrace(5, tau_build=0.0), "tau_build=0.0 must be positive"),
        (lambda: MemoryTrace(5, tau_decay=-1.0), "tau_decay=-1.0 must be positive"),
        (lambda: MemoryTrace(5)(torch.zeros(4)), r"input of shape \[4\] does not end in \[5\]"),
        (lambda: MemoryTrace(0), "shape=0: give a number of sites"),
    ],
)
def test_what_is_wrong_is_refused_in_one_sentence(wrong, words):
    with pytest.raises(ValueError, match=words) as raised:
        wrong()
    assert "\n" not in str(raised.value)

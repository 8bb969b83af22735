"""Cells against mathematics: closed forms, fixed points, invariants, an independent solver."""

import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import lambertw

from dntorch.cells.coincidence import coincidence
from dntorch.cells.functions import abs_sigmoid, heaviside
from dntorch.cells.hebbian import HebbianState, hebbian_step
from dntorch.cells.node import NodeState, node_rate, node_step
from dntorch.cells.opposition import OppositionState, opposition_rate, opposition_step
from dntorch.cells.transient import TransientState, transient_rate, transient_step
from dntorch.cells.value import ValueState, normalized_values, value_rate, value_step
from dntorch.cells.working_memory import (
    WorkingMemoryState,
    working_memory_rate,
    working_memory_step,
)
from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner
from dntorch.modules.node import NodeWTA
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.transient import TPCell
from dntorch.modules.value import ValueNodes
from dntorch.modules.working_memory import ItemOrderWM

# Busy machines are slow, which is no failure.
patient = settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.too_slow])


def f64(x):
    return torch.as_tensor(x, dtype=torch.float64)


def longest_run(true):
    """Most steps in a row for which it is true, over all columns."""
    run, longest = torch.zeros_like(true[0], dtype=torch.int64), 0
    for row in true:
        run = (run + 1) * row
        longest = max(longest, int(run.max()))
    return longest


def first_step(true):
    return int(true.int().argmax())


# Transient pulse cells

DT = 1 / 1024


def pulses(seconds, input=1.0, tau=0.5, dt=DT, state=None):
    """TP+ and TP- after each step of a constant input."""
    state = state or TransientState(f64(0.0), f64(0.0))
    steps = []
    for _ in range(round(seconds / dt)):
        state = transient_step(f64(input), state, tau, dt)
        steps.append(state)
    return TransientState(*(torch.stack(part) for part in zip(*steps, strict=True)))


@pytest.mark.parametrize(("input", "tau"), [(1.0, 0.5), (0.3, 0.5), (2.0, 0.25)])
def test_an_onset_gives_a_pulse_of_known_form_peak_and_area(input, tau):
    cells = pulses(12 * tau, input, tau)
    t = DT * torch.arange(1.0, len(cells.pulse) + 1, dtype=torch.float64)
    decay = torch.exp(-t / tau)
    tolerance = {"rtol": 0, "atol": 2 * DT / tau * input}
    torch.testing.assert_close(cells.inhibitory, input * (1 - decay), **tolerance)
    torch.testing.assert_close(cells.pulse, input * t / tau * decay, **tolerance)
    assert cells.pulse.max() == pytest.approx(input / math.e, rel=4e-3)
    assert t[cells.pulse.argmax()] == pytest.approx(tau, rel=1e-2)
    assert cells.pulse.sum() * DT == pytest.approx(input * tau, rel=1e-3)


def test_an_offset_after_a_long_input_is_the_exact_negative_of_the_onset():
    onset = pulses(4, dt=1 / 32)
    end = TransientState(*(part[-1] for part in pulses(60, dt=1 / 32)))
    offset = pulses(4, input=0.0, dt=1 / 32, state=end)
    torch.testing.assert_close(offset.pulse, -onset.pulse, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dt", [1 / 4, 1 / 32])
def test_the_area_of_a_pulse_does_not_depend_on_the_step(dt):
    assert pulses(60, tau=0.5, dt=dt).pulse.sum() * dt == pytest.approx(0.5, abs=1e-12)


# Item-and-order memory

MEMORY = {"tau": 1.0, "excitation": 1.1, "feedback": 0.8, "threshold": 0.05}
share = st.floats(0, 1)


def nine(numbers=share):
    return st.lists(numbers, min_size=9, max_size=9).map(lambda x: f64(x).view(3, 3))


def remember(pulse, state, steps, dt=1 / 256, **parameters):
    for _ in range(steps):
        state = working_memory_step(pulse, state, **{**MEMORY, **parameters}, dt=dt)
    return state


@patient
@given(u=nine(), pulse=nine())
def test_memory_computes_the_printed_equation(u, pulse):
    rate = working_memory_rate(pulse, WorkingMemoryState(u), **MEMORY).u
    drive = torch.where(pulse > 0.05, pulse, 0.0)
    for i, j in itertools.product(range(3), repeat=2):
        other_pulses = sum(drive[k] for k in np.ndindex(3, 3) if k != (i, j))
        other_cells = sum(u[k] for k in np.ndindex(3, 3) if k != (i, j))
        on_center = (1 - u[i, j]) * (1.1 * drive[i, j] + 0.8 * u[i, j])
        off_surround = u[i, j] * (1.1 * other_pulses + 0.8 * other_cells)
        assert rate[i, j] == pytest.approx(float(on_center - off_surround), abs=1e-12)


@patient
@given(u=nine(st.floats(1e-3, 1)))
def test_without_input_ratios_are_kept_and_the_sum_goes_to_one(u):
    state = WorkingMemoryState(u)
    for seconds in (2, 4, 6, 8):
        state = remember(f64(0.0), state, 128, dt=1 / 64)
        torch.testing.assert_close(state.u / state.u[0, 0], u / u[0, 0])
        logistic = 1 / (1 + (1 / u.sum() - 1) * math.exp(-0.8 * seconds))
        assert state.u.sum() == pytest.approx(float(logistic), abs=0.03)


def test_nothing_remembered_is_a_fixed_point():
    rest = WorkingMemoryState(torch.zeros(3, 3, dtype=torch.float64))
    for pulse in (0.0, 0.05, -1.0):
        assert not working_memory_rate(f64(pulse).expand(3, 3), rest, **MEMORY).u.any()


@patient
@given(u=nine(), inputs=st.lists(nine(), min_size=1, max_size=8), tau=st.floats(0.2, 3))
def test_memory_stays_between_zero_and_one_for_any_pulses(u, inputs, tau):
    """As far as the step allows: dt times (gain times the sum of pulses + ...) within tau."""
    dt, state = tau / (9 * (1.1 + 0.8)), WorkingMemoryState(u)
    for pulse in inputs:
        state = remember(pulse, state, 5, dt=dt, tau=tau)
        assert state.u.min() >= 0 and state.u.max() <= 1 + 1e-12


@patient
@given(pulses=st.lists(st.tuples(st.integers(0, 8), share), min_size=1, max_size=8))
def test_memory_stays_in_bounds_at_the_coarsest_step_it_accepts(pulses):
    """With one pulse at a time, as transitions give them."""
    memory = ItemOrderWM(3, tau=2.0, excitation=1.0, feedback=1.0, dt=1.0).double()
    for cell, size in pulses:
        pulse = torch.zeros(9, dtype=torch.float64)
        pulse[cell] = size
        u = memory(pulse.view(3, 3))
        assert u.min() >= 0 and u.sum() <= 1 + 1e-12


def pulse_area(threshold, tau=0.5):
    """Area of the onset pulse (t/tau) exp(-t/tau) where it is above the threshold."""
    early, late = (-lambertw(-threshold, branch).real for branch in (0, -1))
    return tau * ((early + 1) * math.exp(-early) - (late + 1) * math.exp(-late))


@pytest.mark.parametrize("tau", [1.0, 2.0])
@pytest.mark.parametrize("threshold", [1e-6, 0.05])
def test_one_pulse_weakens_the_others_by_a_constant_factor(tau, threshold):
    settled = f64([[0.0, 0.5, 0.1], [0.2, 0.0, 0.15], [0.05, 0.0, 0.0]])
    state = WorkingMemoryState(settled)
    for pulse in pulses(10, dt=1 / 512).pulse:
        input = torch.zeros(3, 3, dtype=torch.float64)
        input[2, 1] = pulse
        state = remember(input, state, 1, dt=1 / 512, tau=tau, threshold=threshold)
    kept = math.exp(-1.1 * pulse_area(threshold) / tau)
    expected = kept * settled
    expected[2, 1] = 1 - kept
    torch.testing.assert_close(state.u, expected, rtol=2e-3, atol=1e-9)
    if threshold < 0.05:  # the whole pulse: its area is the time constant of the pulse cell
        assert kept == pytest.approx({1.0: 0.577, 2.0: 0.760}[tau], abs=5e-4)


def levels_after(seconds, count=5, dt=1 / 32):
    """Levels of different pairs that were active one after another, the newest first."""
    cells, memory = TPCell((3, 3), dt=dt), ItemOrderWM(3, dt=dt)
    pairs = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)][-count - 1 :]
    for pair in pairs:
        active = torch.zeros(3, 3)
        active[pair] = 1.0
        for _ in range(round(seconds / dt)):
            pulse = cells.state.pulse
            cells(active)
            memory(pulse)
    return [float(memory.u[pair]) for pair in reversed(pairs[1:])]


def test_levels_tell_the_order_of_pairs():
    assert levels_after(6.0) == pytest.approx([0.41, 0.24, 0.14, 0.085, 0.05], abs=5e-3)


def test_levels_do_not_depend_on_how_long_a_behavior_lasts():
    """For behaviours longer than a pulse, 2.2 s. Shorter ones cut their own pulse off."""
    assert levels_after(3.0) == pytest.approx(levels_after(60.0), abs=0.006)
    assert levels_after(1.0)[0] < 0.8 * levels_after(60.0)[0]


def test_levels_keep_while_nothing_happens():
    memory = ItemOrderWM(3)
    for pair in [(0, 1), (1, 2)]:
        pulse = torch.zeros(3, 3)
        pulse[pair] = 1.0
        for _ in range(16):
            memory(pulse)
        for _ in range(32 * 10):
            soon = memory(0 * pulse)
    for _ in range(32 * 60):
        late = memory(0 * pulse)
    torch.testing.assert_close(late, soon, rtol=1e-3, atol=1e-6)


# Value opposition

OPPOSITION = {
    "discount": 0.8, "tau": 0.1, "tau_error": 0.1, "pulse_threshold": 0.05, "trace_threshold": 0.01,
}  # fmt: skip
WEIGHTS = f64([[0.0, 1.5], [0.7, 0.0]])
OLD_AND_NEW = f64([[0.0, 0.2], [-0.2, 0.0]])  # pair (0, 1) comes on, pair (1, 0) goes off


def oppose(pulse, trace, state, seconds, dt=1 / 1024):
    for _ in range(round(seconds / dt)):
        state = opposition_step(pulse, trace, WEIGHTS, state, **OPPOSITION, dt=dt)
    return state


def calm():
    return OppositionState(torch.zeros(2, 2, dtype=torch.float64), f64(0.0))


def test_the_value_cell_goes_to_the_discounted_new_value_minus_the_old_one():
    state = oppose(OLD_AND_NEW, torch.ones(2, 2), calm(), 3.0)
    torch.testing.assert_close(state.opposition, f64([[0.0, 0.8 * 1.5], [-0.7, 0.0]]))
    assert state.error == pytest.approx(0.8 * 1.5 - 0.7)
    assert opposition_rate(
        OLD_AND_NEW, torch.ones(2, 2), WEIGHTS, state, **OPPOSITION
    ).error == pytest.approx(0, abs=1e-9)


def test_opposition_relaxes_exponentially_when_the_pulses_are_over():
    full = oppose(OLD_AND_NEW, torch.ones(2, 2), calm(), 3.0)
    later = oppose(0 * OLD_AND_NEW, torch.ones(2, 2), full, 0.2)
    ratio = 0.2 / 0.1
    torch.testing.assert_close(
        later.opposition, full.opposition * math.exp(-ratio), rtol=0.02, atol=0
    )
    # Two equal time constants in a row: (1 + t/tau) exp(-t/tau).
    assert later.error == pytest.approx(
        float(full.error) * (1 + ratio) * math.exp(-ratio), rel=0.02
    )


@pytest.mark.parametrize("dt", [1 / 32, 1 / 128])
def test_the_area_of_the_error_does_not_depend_on_the_step(dt):
    """What learning integrates: the difference of values times the width of the pulse."""
    area, state = 0.0, calm()
    for step in range(round(8 / dt)):
        pulse = OLD_AND_NEW * (step * dt < 2)
        state = oppose(pulse, torch.ones(2, 2), state, dt, dt)
        area += float(state.error) * dt
    assert area == pytest.approx(2 * (0.8 * 1.5 - 0.7), abs=1e-9)


def test_pairs_that_are_not_remembered_have_no_say():
    trace = f64([[0.0, 0.5], [0.01, 0.0]])
    assert oppose(OLD_AND_NEW, trace, calm(), 3.0).error == pytest.approx(0.8 * 1.5)


def test_weak_pulses_have_no_say():
    assert not oppose(f64([[0.0, 0.05], [-0.05, 0.0]]), torch.ones(2, 2), calm(), 1.0).error


def test_a_pulse_counts_for_a_fixed_time():
    early, late = (-lambertw(-0.05, branch).real for branch in (0, -1))
    width = heaviside(pulses(5.0).pulse, 0.05).sum() * DT
    assert width == pytest.approx(0.5 * (late - early), abs=2 * DT)
    assert width == pytest.approx(2.22, abs=5e-3)


# Hebbian values


@patient
@given(
    reward=st.floats(-2, 2),
    error=st.floats(-2, 2),
    u=share,
    dt=st.sampled_from([1 / 32, 1 / 128]),
    rate=st.floats(0, 1),
)
def test_a_second_of_learning_adds_rate_times_signal_times_trace(reward, error, u, dt, rate):
    state = HebbianState(f64([[0.0, 0.4], [-0.3, 0.0]]))
    start = state.weights
    trace, active = f64([[0.0, u], [u / 2, 0.0]]), f64([[0.0, 0.0], [1.0, 0.0]])
    for _ in range(round(1 / dt)):
        state = hebbian_step(active, trace, f64(error), f64(reward), state, f64(rate), dt)
    change = f64([[0.0, rate * (reward + error) * u], [0.0, 0.0]])  # the running pair keeps its own
    torch.testing.assert_close(state.weights, start + change)


def test_each_of_a_batch_learns_from_its_own_reward():
    values = HebbianQ(2, learning_rate=0.5).spread(3)
    reward, none = torch.tensor([0.0, 1.0, -2.0]), torch.zeros(3)
    weights = values(torch.zeros(3, 2, 2), torch.ones(3, 2, 2), none, reward)
    assert weights[:, 0, 1].tolist() == pytest.approx([0.0, 0.5 / 32, -1.0 / 32])


def test_values_of_one_can_be_spread_and_taken_back():
    values = HebbianQ(2)
    values.state = HebbianState(torch.tensor([[0.0, 1.0], [2.0, 0.0]]))
    assert torch.equal(values.spread(2, 3).weights[1, 2], torch.tensor([[0.0, 1.0], [2.0, 0.0]]))
    values.weights[1, 0] *= 3
    assert torch.equal(values.select(3).weights, torch.tensor([[0.0, 3.0], [6.0, 0.0]]))
    values.forget()
    assert not values.weights.any()


def test_values_that_do_not_fit_a_batch_say_what_to_do():
    values = HebbianQ(2).spread(4)
    with pytest.raises(ValueError, match=r"batch=\[2\] does not fit .* batch \[4\]: call select"):
        values.spread(2)
    with pytest.raises(ValueError, match=r"\[3, 2, 2\] does not fit .* \[4, 2, 2\].*: call spread"):
        values.state = HebbianState(torch.zeros(3, 2, 2))
    with pytest.raises(ValueError, match=r"\[3, 2, 2\] do(es)? not fit .* \[2, 2\]: call spread"):
        HebbianQ(2)(torch.zeros(3, 2, 2), torch.zeros(3, 2, 2), torch.zeros(3), torch.zeros(3))
    with pytest.raises(ValueError, match="index=0: there is one set of weights only"):
        HebbianQ(2).select(0)
    with pytest.raises(ValueError, match=r"batch=\[2\] does not fit .* batch \[4\]: call select"):
        DNSarsa(2).spread(4).resize(2)


# Value nodes

BASE, NONE = f64([1e-3, 1.1e-3, 1.2e-3]), f64([0.0, 0.0, 0.0])


def values_of(satisfaction, weights, noise, sharpness):
    """Of the actions but the finished one."""
    available = satisfaction <= 0.5
    return normalized_values(satisfaction, weights, noise, available, BASE, sharpness)


@patient
@given(
    satisfaction=st.lists(share, min_size=3, max_size=3).map(f64),
    weights=nine(st.floats(-5, 5)),
    noise=st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(f64),
)
def test_the_best_has_one_and_a_finished_one_nothing(satisfaction, weights, noise):
    values = values_of(satisfaction, weights, noise, 8.0)
    state = satisfaction > 0.5
    assert (values[state] == 0).all() and values.max() == (0 if state.all() else 1)
    learned = (weights @ state.double() + noise).clamp_min(0) + BASE
    if not state.all():
        expected = (learned / learned[~state].max()) ** 8
        torch.testing.assert_close(values[~state], expected[~state])


@pytest.mark.parametrize("weight", [0.0, -1.0])
def test_values_where_nothing_good_was_learned_are_the_innate_preference(weight):
    weights = f64(weight).expand(3, 3)
    values = values_of(f64([0.001, 0.001, 0.001]), weights, NONE, 1.0)
    torch.testing.assert_close(values, BASE / BASE.max())
    values = values_of(f64([0.001, 0.999, 0.001]), weights, NONE, 1.0)
    torch.testing.assert_close(values, f64([1.0, 0.0, 1.2]) / 1.2)  # the finished one has none


def test_values_read_the_column_of_the_current_state():
    weights = f64([[0.0, 5.0, 1.0], [3.0, 0.0, 1.0], [1.0, 5.0, 0.0]])
    values = values_of(f64([0.99, 0.01, 0.01]), weights, NONE, 2.0)
    expected = f64([0.0, 3.0, 1.0]) + BASE * f64([0.0, 1.0, 1.0])
    torch.testing.assert_close(values, (expected / expected.max()) ** 2)


def test_noise_decides_before_there_is_a_state():
    noise = f64([1.0, 9.0, 4.0])
    values = values_of(f64([0.001, 0.001, 0.001]), torch.zeros(3, 3).double(), noise, 1.0)
    torch.testing.assert_close(values, (noise + BASE) / (9 + BASE[1]))


def test_resting_nodes_are_no_state():
    """However many they are and whatever their values."""
    rest = abs_sigmoid(torch.full((3,), -5.0, dtype=torch.float64), 100.0, 0.0)
    values = values_of(rest, 10 * torch.ones(3, 3, dtype=torch.float64), NONE, 1.0)
    torch.testing.assert_close(values, BASE / BASE.max())


def test_values_ignore_the_diagonal():
    nodes = ValueNodes(3)
    state = torch.tensor([1.0, 0.0, 0.0])
    for _ in range(64):
        value = nodes(state, 100 * torch.eye(3), torch.zeros(3), 1 - state)
    assert value[0] == 0 and value[2] == pytest.approx(1)


# State-action cells


def test_a_pair_is_active_where_intention_and_satisfaction_are():
    off_diagonal = 1 - torch.eye(4)
    for i, j in itertools.product(range(4), repeat=2):
        intention, satisfaction = torch.full((4,), 0.001), torch.full((4,), 0.001)
        intention[i] = satisfaction[j] = 0.99
        active = coincidence(intention, satisfaction, off_diagonal, 0.5)
        assert active.sum() == (i != j)  # a pair (i, i) does not exist
        assert active[i, j] == (i != j)


# Nodes

NODE = {"tau": 0.3, "h": -5.0, "excitation": 10.0, "inhibition": 30.0, "steepness": 100.0,
        "threshold": 0.0}  # fmt: skip


def fixed_points(input, excitation):
    """Where a single node rests: roots of -u + h + c f(u) + S, from a solver of its own."""

    def rate(u):
        return -u - 5 + excitation * (0.5 + 50 * u / (1 + 100 * abs(u))) + input

    grid = np.linspace(-30, 30, 20_000)
    values = np.array([rate(u) for u in grid])
    changes = np.nonzero(np.diff(np.sign(values)))[0]
    return [brentq(rate, grid[k], grid[k + 1], xtol=1e-14) for k in changes]


@pytest.mark.parametrize(
    ("input", "excitation", "count"),
    [(0.0, 10.0, 3), (0.0, 4.0, 1), (6.0, 10.0, 1), (-6.0, 10.0, 1)],
)
def test_a_node_rests_at_its_fixed_points(input, excitation, count):
    roots = fixed_points(input, excitation)
    assert len(roots) == count
    parameters = {**NODE, "excitation": excitation}
    for u in roots:
        state = NodeState(f64([u]))
        assert node_rate(f64([input]), state, **parameters).u == pytest.approx(0, abs=1e-9)
        assert node_step(f64([input]), state, **parameters, dt=1 / 32).u == pytest.approx(u)


def run_node(node, input, seconds=3.0):
    for _ in range(round(seconds / node.dt)):
        output = node(torch.as_tensor([input]))
    return bool(output > 0.5)


def test_a_node_detects_remembers_and_forgets():
    node = NodeWTA(1)
    assert not run_node(node, 4.5)
    assert run_node(node, 5.5)
    assert run_node(node, 0.0)  # self-excitation 10 exceeds 5
    assert not run_node(node, -6.0)
    weak = NodeWTA(1, excitation=4.0)
    assert run_node(weak, 5.5) and not run_node(weak, 0.0)


def decide(module, drive, steps):
    """Which nodes are on, ``(steps, batch, n)``, while a drive lasts."""
    return torch.stack([module(drive) > 0.5 for _ in range(steps)])


def shares_of_value(n, seed, batch=200, finished=False):
    """Without exact ties: from nearly even to nearly all for one, as noise or learning give."""
    generator = torch.Generator().manual_seed(seed)
    weight = torch.rand(batch, n, generator=generator, dtype=torch.float64)
    weight = weight ** (4 * torch.rand(batch, 1, generator=generator))
    if finished:
        weight[:, 0] = 0
    share = weight / weight.sum(-1, keepdim=True)
    best = share.sort(-1).values
    return share[best[:, -1] - best[:, -2] > 1e-3 * best[:, -1]].float()


@settings(patient, max_examples=10)
@given(n=st.integers(2, 8), seed=st.integers(0, 2**32))
def test_two_winners_never_last_longer_than_two_steps(n, seed):
    """Also where the input changes in the middle of a decision."""
    nodes, drive = NodeWTA(n), 20 * shares_of_value(n, seed)
    nodes.resize(len(drive))
    on = [decide(nodes, part, 48) for part in (drive, drive.roll(1, 0), drive.roll(1, 1))]
    assert torch.cat(on).any()
    assert longest_run(torch.cat(on).sum(-1) > 1) <= 2


@pytest.mark.parametrize(("input", "winners"), [(24.0, 1), (26.0, 2)])
def test_two_nodes_stay_on_together_only_if_both_inputs_exceed_their_inhibition(input, winners):
    """inhibition - excitation - h = 30 - 10 + 5 = 25"""
    nodes = NodeWTA(2)
    nodes.state = NodeState(torch.tensor([6.0, 5.9]))
    assert decide(nodes, torch.tensor([input, 0.99 * input]), 96)[-1].sum() == winners


@settings(patient, max_examples=10)
@given(n=st.integers(2, 64), seed=st.integers(0, 2**32))
def test_after_any_behavior_the_one_with_the_largest_value_starts(n, seed):
    share = shares_of_value(n, seed, finished=True)
    value = (share / share.amax(-1, keepdim=True)) ** 8
    behaviors, nothing_found = ElementaryBehaviors(n), torch.zeros(len(share), n)
    behaviors.resize(len(share))
    behaviors.satisfaction.u[:, 0] = 3.0
    intentions = torch.stack([behaviors(value, nothing_found)[0] > 0.5 for _ in range(320)])
    assert longest_run(intentions.sum(-1) > 1) <= 2
    assert (intentions[-1].sum(-1) == 1).all()
    assert torch.equal(intentions[-1].int().argmax(-1), share.argmax(-1))


# Elementary behaviours


def behave(behaviors, value, match, seconds):
    """Whether intention and CoS nodes are on, ``(steps, n)`` each."""
    steps = [
        behaviors(torch.tensor(value), torch.tensor(match))
        for _ in range(round(seconds / behaviors.dt))
    ]
    intention, satisfaction = (torch.stack(part) for part in zip(*steps, strict=True))
    return intention > 0.5, satisfaction > 0.5


def test_a_completed_behavior_ends_hands_over_and_stays_represented():
    behaviors = ElementaryBehaviors(3)
    intention, satisfaction = behave(behaviors, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 3.0)
    assert intention[-1].tolist() == [True, False, False] and not satisfaction.any()
    # Found: its CoS comes on and ends the intention, although it is still wanted.
    intention, satisfaction = behave(behaviors, [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 2.0)
    assert satisfaction[-1].tolist() == [True, False, False] and not intention[-1].any()
    # Another is wanted: it runs for a minute, and the state is what was completed last.
    intention, satisfaction = behave(behaviors, [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], 60.0)
    assert intention[-1].tolist() == [False, True, False]
    assert (satisfaction == torch.tensor([True, False, False])).all()
    # The next completion takes over, with an overlap of two steps at most and no gap.
    intention, satisfaction = behave(behaviors, [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 3.0)
    assert satisfaction[-1].tolist() == [False, True, False]
    assert satisfaction.any(-1).all()
    assert longest_run((satisfaction.sum(-1) > 1).unsqueeze(-1)) <= 2


# Deviations: what the printed forms would do


def test_with_a_positive_resting_level_every_node_is_on_at_rest():
    state, without = NodeState(torch.full((4,), -5.0)), torch.zeros(4)
    alone = {**NODE, "inhibition": 0.0, "excitation": 8.0}  # CoS nodes as printed
    for _ in range(320):
        state = node_step(without, state, **{**alone, "h": 5.0}, dt=1 / 32)
    assert (state.u > 0).all()
    with pytest.raises(ValueError, match="must be negative: with another every node is on"):
        NodeWTA(4, h=5.0)


def test_the_printed_sigmoid_is_not_bounded_by_zero_and_one():
    x = f64([-3.0, -0.1, 0.1, 3.0])
    printed = (1 + 100 * x) / (2 * (1 + 100 * x.abs()))
    assert (printed[:2] < 0).all() and (printed[2:] == 0.5).all()
    used = abs_sigmoid(x, 100.0, 0.0)
    assert (used > 0).all() and (used < 1).all() and (used.diff() > 0).all()


def test_value_nodes_without_a_leak_diverge():
    satisfaction, weights = f64([1.0, 0.0, 0.0]), f64([[0, 0, 0], [2, 0, 0], [1, 0, 0]])
    printed, state = torch.zeros(3, dtype=torch.float64), ValueState(f64([0.0, 0.0, 0.0]))
    for _ in range(32 * 60):
        printed = printed + 1 / 32 / 0.1 * weights @ satisfaction
        state = value_step(
            satisfaction, weights, NONE, satisfaction < 0.5, state, BASE, 8.0, 0.1, 1 / 32
        )
    assert printed.max() > 1000
    assert state.value.max() == pytest.approx(1)


def test_plain_normalization_divides_zero_by_zero_at_the_start():
    sums = torch.zeros(3, 3) @ torch.tensor([1.0, 0.0, 0.0])
    assert (sums / sums.sum()).isnan().all()
    nodes = ValueNodes(3)
    state = torch.tensor([1.0, 0.0, 0.0])
    for _ in range(64):
        value = nodes(state, torch.zeros(3, 3), torch.zeros(3), 1 - state)
    assert value.max() == pytest.approx(1) and value.argmax() == 2


def test_a_heaviside_without_threshold_sees_every_pair_at_rest():
    rest = abs_sigmoid(torch.full((4,), -5.0), 100.0, 0.0)
    everywhere = torch.ones(4, 4)
    assert coincidence(rest, rest, everywhere, 0.0).all()
    assert not coincidence(rest, rest, everywhere, 0.5).any()


def test_without_a_threshold_a_pulse_never_ends():
    tail = pulses(30.0, dt=1 / 32).pulse[-32 * 20 :]  # ten seconds after the onset and later
    assert heaviside(tail, 0.0).all() and not heaviside(tail, 0.05).any()
    with pytest.raises(ValueError, match="at 0 a pulse never ends"):
        ValueOpposition(3, pulse_threshold=0.0)


def test_the_printed_inhibition_leaves_two_intentions_on():
    inputs = torch.tensor([10.0, 9.9, 0.0, 0.0])
    on = {}
    for inhibition in (10.0, 30.0):
        nodes = NodeWTA(4, inhibition=inhibition)
        for _ in range(32 * 60):
            output = nodes(inputs)
        on[inhibition] = int((output > 0.5).sum())
    assert on == {10.0: 2, 30.0: 1}


def test_with_the_printed_inhibition_a_finished_intention_does_not_end_by_itself():
    still_on = {}
    for gain in (5.0, None):
        behaviors = ElementaryBehaviors(4, completion_gain=gain)
        behave(behaviors, [0.7, 0.1, 0.1, 0.1], [0.0] * 4, 3.0)
        intention, satisfaction = behave(
            behaviors, [0.7, 0.1, 0.1, 0.1], [1.0, 0.0, 0.0, 0.0], 10.0
        )
        assert satisfaction[-1, 0]
        still_on[gain] = bool(intention[-1, 0])
    assert still_on == {5.0: True, None: False}


def test_without_self_sustained_satisfaction_the_state_is_lost():
    lasting = {}
    for excitation in (4.0, 8.0):
        satisfaction = NodeWTA(3, excitation=excitation, inhibition=8.0)
        behaviors = ElementaryBehaviors(3, satisfaction=satisfaction)
        behave(behaviors, [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 3.0)
        _, on = behave(behaviors, [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], 3.0)
        lasting[excitation] = bool(on[-1, 0])
    assert lasting == {4.0: False, 8.0: True}


# An independent solver

GENERATOR = np.random.default_rng(7)
NODE_INPUT, NODE_START = GENERATOR.uniform(0, 9, 4), GENERATOR.uniform(-6, -1, 4)
PAIR_INPUT, PAIR_START = GENERATOR.uniform(0.1, 0.6, 9), GENERATOR.uniform(0, 0.1, 9)
VALUES, NOISE = GENERATOR.uniform(0, 2, (3, 3)), GENERATOR.uniform(0, 2, 3)


def numpy_node(u):
    f = 0.5 + 2 * u / (1 + 4 * abs(u))
    return (-u - 5 + 10 * f - 30 * (f.sum() - f) + NODE_INPUT) / 0.3


def numpy_transient(x):
    pulse, inhibitory = x
    return np.array([0.7 - pulse - inhibitory, 0.7 - inhibitory]) / 0.5


def numpy_memory(u):
    q = 1.1 * PAIR_INPUT
    on_center = (1 - u) * (q + 0.8 * u)
    return on_center - u * ((q.sum() - q) + 0.8 * (u.sum() - u))


def numpy_opposition(x):
    field, error = x[:4], x[4]
    target = np.array([0.0, 0.8 * 1.5, -0.7, 0.0])
    return np.append((target - field) / 0.1, (field.sum() - error) / 0.15)


def numpy_value(x):
    worth = (VALUES[:, 0] + NOISE + BASE.numpy()) * [0, 1, 1]  # in state 0
    return ((worth / worth.max()) ** 3 - x) / 0.1


def torch_node(x):
    return node_rate(f64(NODE_INPUT), NodeState(x), **{**NODE, "steepness": 4.0}).u


def torch_transient(x):
    return torch.stack(transient_rate(f64(0.7), TransientState(*x), 0.5))


def torch_memory(x):
    input, state = f64(PAIR_INPUT).view(3, 3), WorkingMemoryState(x.view(3, 3))
    return working_memory_rate(input, state, **MEMORY).u.flatten()


def torch_opposition(x):
    parameters = {**OPPOSITION, "tau_error": 0.15}
    state = OppositionState(x[:4].view(2, 2), x[4])
    rate = opposition_rate(OLD_AND_NEW, torch.ones(2, 2), WEIGHTS, state, **parameters)
    return torch.cat((rate.opposition.flatten(), rate.error.view(1)))


def torch_value(x):
    state, noise = f64([0.9, 0.1, 0.2]), f64(NOISE)
    inputs = state, f64(VALUES), noise, state < 0.5
    return value_rate(*inputs, ValueState(x), BASE, 3.0, 0.1).value


PROBLEMS = {
    "node": (numpy_node, torch_node, NODE_START),
    "transient": (numpy_transient, torch_transient, np.zeros(2)),
    "working memory": (numpy_memory, torch_memory, PAIR_START),
    "opposition": (numpy_opposition, torch_opposition, np.zeros(5)),
    "value": (numpy_value, torch_value, np.zeros(3)),
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
@pytest.mark.parametrize("seconds", [0.125, 0.25, 0.5])
def test_euler_converges_with_order_one_to_an_independent_solution(problem, seconds):
    reference, rate, start = problem
    exact = solve_ivp(lambda _, x: reference(x), (0, seconds), start, rtol=1e-12, atol=1e-12).y[
        :, -1
    ]
    steps, errors = (128, 192, 256, 384), []
    for count in steps:
        x = f64(start)
        for _ in range(count):
            x = x + seconds / count * rate(x)
        errors.append(np.abs(x.numpy() - exact).max())
    assert errors[-1] < 0.02 * np.abs(exact).max()
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1, abs=0.1)


# Arguments


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: NodeWTA(0), "n=0: give at least one"),
        (lambda: NodeWTA(3, h=0.0), "h=0.0 must be negative"),
        (lambda: NodeWTA(3, tau=0.01), "dt=0.03125 is longer than tau=0.01"),
        (lambda: NodeWTA(3, dt=-1.0), "dt=-1.0 must be positive"),
        (lambda: TPCell((), tau=0.01), "dt=0.03125 is longer than tau=0.01"),
        (lambda: TPCell((), tau=0.0), "tau=0.0 must be positive"),
        (lambda: TPCell((), dt=float("nan")), "dt=nan is not finite"),
        (lambda: ItemOrderWM(3, tau=0.05), r"with tau=0.05: activity could leave \[0, 1\]"),
        (lambda: ValueOpposition(3, tau_error=0.01), "longer than tau_error=0.01"),
        (lambda: ValueOpposition(3, discount=1.1), "discount=1.1: give a number from 0 to 1"),
        (lambda: ValueOpposition(3, trace_threshold=-1.0), "trace_threshold=-1.0 must be positive"),
        (lambda: HebbianQ(3, learning_rate=0.0), r"learning_rate=0.0 .* call learn\(False\)"),
        (lambda: ValueNodes(1), "n=1: give at least two"),
        (lambda: ValueNodes(3, baseline=0.0), "baseline=0.0 must be positive"),
        (lambda: ElementaryBehaviors(1), "n=1: give at least two"),
        (lambda: Learner(3, coincidence_threshold=1.0), "coincidence_threshold=1.0: .* 0 and 1"),
        (lambda: DNSarsa(3, learner=Learner(4)), r"learner.*n=4 does not fit n=3: build the part"),
        (lambda: DNSarsa(3, substeps=2, learner=Learner(3)), "dt=.* does not fit: build"),
        (lambda: DNSarsa(3, substeps=0), "substeps=0"),
        (lambda: DNSarsa(3, integrator="rk4"), "integrator='rk4'.*'euler' or 'heun'"),
    ],
)  # fmt: skip
def test_wrong_arguments_name_argument_value_and_remedy(build, message):
    with pytest.raises(ValueError, match=message):
        build()

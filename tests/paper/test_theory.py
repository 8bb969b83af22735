"""What theory expects, against the structures themselves and against closed forms."""

import math

import pytest

from dntorch.modules.learner import Learner
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.paper.comparison import reference
from dntorch.paper.theory import Theory, pulse_above, theory
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config


def expected(learner: Learner | None = None, gap: float = 0.5, **reward) -> Theory:
    reward = {"reward": 2.0, "reward_duration": 1.0} | reward
    return theory(learner or build_agent(Config(world="nodes")).learner, gap, **reward)


def changed(**parameters: float) -> Theory:
    """Theory of a learner one of whose parts, ``part__name``, is not as usual."""
    learner = build_agent(Config(world="nodes")).learner
    for path, value in parameters.items():
        part, _, name = path.partition("__")
        assert hasattr(getattr(learner, part), name)
        setattr(getattr(learner, part), name, value)
    return expected(learner)


def test_theory_of_the_trace_is_what_the_memory_does() -> None:
    dt, n = 1 / 1024, 3
    cell, memory = TPCell((n, n), dt=dt), ItemOrderWM(n, dt=dt)
    decays = []
    for site in [(0, 1), (1, 2), (2, 0)]:
        before = memory.u.clone()
        for _ in range(8 * 1024):
            pair = cell.pulse.new_zeros(n, n)
            pair[site] = 1.0
            memory(cell(pair).clamp_min(0))
        decays.append(float(memory.u[0, 1] / before[0, 1]))
    assert decays[1:] == pytest.approx([expected().decay] * 2, rel=0.01)


def test_theory_of_the_learning_rate() -> None:
    still = expected(gap=50.0)  # the trace fades after all is over
    assert still.old == pytest.approx(still.settled, rel=0.01)
    assert still.reward == pytest.approx(0.06 * (1 - still.decay) * 2.0, rel=0.01)
    assert still.width == pytest.approx(2.2235, abs=1e-3)
    near = expected()
    assert near.next < near.old < near.settled
    with pytest.raises(ValueError, match="threshold=0"):
        pulse_above(0.0, 0.5)


def test_theory_follows_the_parameters_of_the_learner() -> None:
    usual = expected()
    slow = changed(values__learning_rate=0.03)
    assert (slow.old, slow.next, slow.reward) == pytest.approx(
        (usual.old / 2, usual.next / 2, usual.reward / 2)
    )
    assert changed(trace__tau=2.0).decay == pytest.approx(math.sqrt(usual.decay))
    assert changed(trace__excitation=2.2).decay == pytest.approx(usual.decay**2)
    assert changed(pulses__tau=1.0).width == pytest.approx(2 * usual.width)
    higher = changed(opposition__pulse_threshold=0.1)
    assert higher.width < usual.width and higher.decay == usual.decay
    assert changed(trace__threshold=0.1).decay > usual.decay
    for name in ("tau", "tau_error"):
        assert changed(**{f"opposition__{name}": 0.2}).old < usual.old
    assert expected(reward=4.0).reward == pytest.approx(2 * usual.reward)


def test_the_discrete_learner_discounts_as_the_neural_one_does() -> None:
    patient = changed(opposition__discount=0.9)
    learning = reference(patient)
    assert learning.discount == patient.discount == 0.9
    assert learning.discount * learning.trace_decay == pytest.approx(expected().decay)

"""The discrete learner against closed forms and a slow reference."""

import numpy as np
import pytest

from dntorch.paper.comparison import yoked_optimal
from dntorch.paper.discrete import (
    Learning,
    Sarsa,
    executes,
    explore_or_exploit,
    greedy,
    yoked,
)
from dntorch.paper.runs import Runs
from dntorch.runs.config import Config


def slow(behaviors: list[int], rewarded: list[bool], learning: Learning, n: int = 4) -> np.ndarray:
    """SARSA(lambda) as in the textbook: one run, one dictionary, one loop over all traces."""
    q = {(s, a): 0.0 for s in range(n) for a in range(n)}
    e: dict[tuple[int, int], float] = {}
    for t in range(1, len(behaviors) - 1):
        s, a, following = behaviors[t - 1 : t + 2]
        for pair in e:
            e[pair] *= learning.discount * learning.trace_decay
        e[s, a] = 1.0 if learning.replacing else e.get((s, a), 0.0) + 1
        delta = rewarded[t] + learning.discount * q[a, following] - q[s, a]
        for pair, eligibility in e.items():
            q[pair] += learning.rate * delta * eligibility
    return np.array([[q[s, a] for a in range(n)] for s in range(n)])


@pytest.mark.parametrize("replacing", [False, True])
@pytest.mark.parametrize("decay", [0.0, 0.5, 1.0])
def test_equals_a_slow_reference(replacing: bool, decay: float) -> None:
    learning = Learning(0.1, decay, 0.8, replacing=replacing)
    history = explore_or_exploit(learning, np.full(20, 60), np.full(20, 90), 3, "GBG")
    for run in range(20):
        behaviors, rewarded = history.behaviors[run], history.rewarded[run]
        values, _ = yoked(learning, behaviors[None], rewarded[None], 4)
        np.testing.assert_allclose(
            values[0], slow(behaviors.tolist(), rewarded.tolist(), learning), atol=1e-12
        )
    assert history.rewarded.sum() > 20


def test_first_reward_reaches_back_as_the_trace_does() -> None:
    behaviors = np.array([[1, 2, 3, 0, 1, 2]])  # G B Y R G, and then B
    rewarded = np.array([[False] * 4 + [True, False]])
    values, _ = yoked(Learning(0.1, 0.5, 0.8), behaviors, rewarded, 4)
    back = [values[0, s, a] for s, a in [(0, 1), (3, 0), (2, 3), (1, 2)]]
    np.testing.assert_allclose(back, [0.1 * 0.4**k for k in range(4)])


def test_td0_teaches_only_the_last_pair() -> None:
    behaviors, rewarded = np.array([[1, 2, 3, 0, 1, 2]]), np.array([[0, 0, 0, 0, 1, 0]])
    values, _ = yoked(Learning(0.1, 0.0, 0.8), behaviors, rewarded, 4)
    assert (values != 0).sum() == 1 and values[0, 0, 1] == pytest.approx(0.1)


def test_a_constant_reward_is_valued_as_the_sum_of_its_future() -> None:
    count = 4000
    behaviors = np.tile([0, 1], count // 2)[None]
    values, _ = yoked(Learning(0.1, 0.7, 0.8), behaviors, np.ones((1, count)), 2)
    np.testing.assert_allclose([values[0, 0, 1], values[0, 1, 0]], 1 / (1 - 0.8), rtol=1e-6)


def test_replacing_differs_from_accumulating_only_when_pairs_repeat() -> None:
    both = []
    for behaviors in ([0, 1, 2, 3, 0, 2], [0, 1, 0, 1, 0, 1]):
        rewarded = np.ones((1, 6))
        plain, replacing = (
            yoked(Learning(0.1, 0.9, 0.8, replacing=kind), np.array([behaviors]), rewarded, 4)[0]
            for kind in (False, True)
        )
        both.append(np.allclose(plain, replacing))
    assert both == [True, False]


def test_no_behavior_repeats_and_choice_is_uniform() -> None:
    history = explore_or_exploit(Learning(0.05, 0.7, 0.8), np.full(200, 300), np.full(200, 300), 1)
    c = history.behaviors
    assert (c[:, 1:] != c[:, :-1]).all()
    step = (c[:, 1:] - c[:, :-1]) % 4
    assert abs(np.bincount(step.ravel(), minlength=4)[1:] / step.size - 1 / 3).max() < 0.01


def test_chances_of_other_runs_are_followed() -> None:
    chances = np.broadcast_to(1 - np.eye(4), (4, 4, 4)).copy()
    for i in range(4):
        chances[i, :, i] = 0  # never back to the behaviour before last
    total = np.full(50, 100)
    c = explore_or_exploit(Learning(0.05, 0.7, 0.8), total, total, 2, chances=chances).behaviors
    assert (c[:, 3:] != c[:, 1:-2]).all() and (c[:, 1:] != c[:, :-1]).all()


def test_traces_learn_the_sequence_and_td0_does_not() -> None:
    explore, total = np.full(300, 300), np.full(300, 600)
    share = {}
    for decay in (0.75, 0.0):
        history = explore_or_exploit(Learning(0.05, decay, 0.8), explore, total, 5)
        found = history.rewarded[:, :300].any(1)
        share[decay] = (history.rewarded[found, -40:].sum(1) >= 9).mean()
        assert 0.5 < found.mean() < 0.7  # 1 - (1 - 1/324)**296 = .60
    assert share[0.75] > 0.97 and share[0.0] < 0.1


def test_each_run_ends_after_its_own_number_of_behaviors() -> None:
    explore, total = np.array([10, 20]), np.array([30, 50])
    history = explore_or_exploit(Learning(0.05, 0.7, 0.8), explore, total, 0)
    assert (history.behaviors >= 0).sum(1).tolist() == [30, 50]


def test_greedy_policy() -> None:
    values = np.zeros((4, 4))
    values[1, 2] = values[2, 3] = values[3, 0] = values[0, 1] = 0.1
    choice = greedy(values, np.arange(4) / 4)
    assert choice.tolist() == [1, 2, 3, 0]
    assert executes(choice, np.array([1, 2, 3, 0, 1]))
    assert not executes(choice, np.array([1, 3, 2, 0, 1]))
    # A negative value is no worse than none for value nodes, which rectify.
    values[1] = [-0.3, 0, -0.1, -0.2]
    assert greedy(values + np.diag([0, 9, 0, 0]), np.arange(4) / 4)[1] == 2
    assert greedy(values, np.arange(4) / 4, rectified=True)[1] == 3


def test_a_learner_keeps_runs_apart() -> None:
    learner = Sarsa(2, 3, Learning(0.5, 0.5, 0.8))
    state, action = np.array([0, 1]), np.array([1, 2])
    learner.visit(state, action, np.array([True, False]))
    learner.learn(np.array([1, 1]), (state, action), (action, state), np.array([True, False]))
    assert learner.values[0, 0, 1] == 0.5 and not learner.values[1].any()


def test_the_yoked_learner_follows_what_its_exploration_taught() -> None:
    found = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 3]  # R G B Y R G B Y R G, twice rewarded
    never = [0, 1, 0, 2, 0, 3, 0, 1, 0, 2, 0]
    other = [0, 1, 3, 2, 0, 1, 3, 2, 0, 1, 3]
    behaviors = np.array([found, other, never])
    rewarded = np.zeros(behaviors.shape, bool)
    rewarded[:2, [5, 9]] = True
    empty = np.zeros(0)
    runs = Runs(behaviors, behaviors, rewarded, empty, empty, empty, empty)
    explored, learning = np.full(3, 10), Learning(0.1, 0.7, 0.8)
    assert yoked_optimal(runs, explored, Config(), ("GBYRG",), learning) == [1, 2]
    assert yoked_optimal(runs, explored, Config(), ("GBYRG", "GYBRG"), learning) == [2, 2]

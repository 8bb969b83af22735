"""Statistics against known values, and measures against events made by hand."""

import math

import numpy as np
import pytest

from dntorch.paper import statistics as st
from dntorch.paper.law import correlation, transition_counts
from dntorch.paper.runs import match, runs_from_events
from dntorch.paper.success import policies, success
from dntorch.runs.config import Config


def test_wilson() -> None:
    # Newcombe 1998, table I: 81 of 263.
    assert st.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert st.wilson(381, 381)[0] > 0.99 > st.wilson(379, 379)[0]
    assert st.wilson(0, 0) == (0.0, 1.0)


def test_equivalence_of_proportions_can_fail() -> None:
    same = st.equivalent_proportions((800, 800), (600, 600), 0.02)
    assert same["p"] < 0.001
    few = st.equivalent_proportions((20, 20), (20, 20), 0.02)
    assert few["p"] > 0.05 and not few["decidable"] and same["decidable"]
    assert st.equivalent_proportions((780, 800), (800, 800), 0.02)["p"] > 0.05
    assert st.equivalent_proportions((0, 0), (5, 5), 0.02)["p"] == 1.0


def test_equivalence_of_means_can_fail() -> None:
    random = np.random.default_rng(0)
    a, b = random.normal(100, 60, (2, 800))
    assert st.equivalent_means(a, b, 0.2)["p"] < 0.01
    assert not st.equivalent_means(a[:9], b[:9], 0.2)["decidable"]
    different = st.equivalent_means(2 * a, b, 0.2)
    assert different["p"] > 0.99 and different["decidable"]
    assert st.equivalent_means(a * 1.25, b, 0.2)["p"] > 0.05
    assert st.equivalent_means(a[:5], b[:5], 0.2)["p"] > 0.05


def test_regression_recovers_coefficients() -> None:
    random = np.random.default_rng(1)
    x = random.normal(size=(500, 3))
    fit = st.regression(x, x @ [0.04, 0.05, 0.06] + 0.001 * random.normal(size=500))
    assert fit.coefficients == pytest.approx([0.04, 0.05, 0.06], abs=5e-4)
    assert 0.999 < fit.r2 < 1
    noise = st.regression(x, random.normal(size=500))
    assert noise.r2 < 0.05
    assert math.isnan(st.regression(x[:2], x[:2, 0]).r2)


def test_chi_square() -> None:
    # Fair die of Wikipedia's example, 60 throws: 5, 8, 9, 8, 10, 20.
    test = st.uniformity(np.array([5, 8, 9, 8, 10, 20]))
    assert test["chi2"] == pytest.approx(13.4) and test["dof"] == 5
    assert test["p"] == pytest.approx(0.0199, abs=1e-4) and test["decidable"]
    assert not st.uniformity(np.zeros(6, int))["decidable"]


def test_summary() -> None:
    assert st.summary(np.arange(5))["quartiles"] == [1.0, 3.0]
    assert st.summary(np.array([]))["median"] is None
    low, high = st.mean_interval(np.array([1.0, 2.0, 3.0]))
    assert (low, high) == pytest.approx((2 - 2.484, 2 + 2.484), abs=1e-3)


def test_match_pairs_onsets_with_finds() -> None:
    steps, behaviors = np.array([10, 200, 400, -1]), np.array([1, 2, 3, -1])
    finds = np.array([[9, 1, 0], [200, 2, 1], [399, 3, 0]])
    rewarded, disagreements = match(steps, behaviors, finds)
    assert rewarded.tolist() == [False, True, False, False] and disagreements == 0
    rewarded, disagreements = match(steps, behaviors, finds[1:])
    assert rewarded.tolist() == [False, True, False, False] and disagreements == 1
    wrong = finds.copy()
    wrong[1, 1] = 0
    assert not match(steps, behaviors, wrong)[0].any()


def test_success_of_runs_made_by_hand() -> None:
    columns = 100
    rewarded, policy = np.zeros((2, 3, columns), bool)
    rewarded[0, 20], rewarded[0, 51::4] = True, True  # found early, optimal from then on
    rewarded[1, 51::4] = True  # finds it only while exploiting
    rewarded[2, 30] = True  # found, then lost
    policy[0, 60:], policy[1, 50:] = True, True
    total = np.full(3, columns)
    result = success(rewarded, policy, np.full(3, 50), total, 9)
    assert result.found.tolist() == [True, False, True]
    assert result.optimal.tolist() == [True, True, False]
    assert result.late.tolist() == [True, False, False]
    assert result.first.tolist() == [20, -1, 30]
    assert result.needed.tolist() == [61, 51, -1]


def test_policies_see_values_as_the_value_nodes_do() -> None:
    values = np.full((4, 4), -0.1)
    for s, a in [(1, 2), (2, 3), (3, 0), (0, 1)]:
        values[s, a] = 0.02
    config = Config(world="nodes")
    assert policies(values, config)
    values[2, 0] = 0.03
    assert not policies(values, config)


def test_events_become_runs() -> None:
    onset = np.array([[0, 10, 1], [1, 12, 0], [0, 200, 2], [0, 400, 1]])
    events = {
        "onset": onset,
        "find": np.array([[0, 9, 1, 0], [1, 11, 0, 0], [0, 199, 2, 0], [0, 400, 1, 1]]),
        "error": np.arange(8.0).reshape(4, 2),
        "weights": np.arange(64.0).reshape(4, 4, 4),
        "trouble": np.zeros((2, 2)),
    }
    runs = runs_from_events(events, 2)
    assert runs.behaviors.tolist() == [[1, 2, 1], [0, -1, -1]]
    assert runs.rewarded.tolist() == [[False, False, True], [False] * 3]
    assert runs.weights[0, 1, 2, 3] == events["weights"][2, 3, 2]  # [state, action] now
    assert transition_counts(runs, 1000, 4)[1, 2, 1] == 1
    assert transition_counts(runs, 300, 4).sum() == 0


def test_correlation_ignores_the_diagonal() -> None:
    a = np.random.default_rng(0).normal(size=(2, 4, 4))
    b = 2 * a + 1 + 9 * np.eye(4)
    assert correlation(a, b) == pytest.approx([1, 1])
    assert np.isnan(correlation(a, np.zeros_like(a))).all()

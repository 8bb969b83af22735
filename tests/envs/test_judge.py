"""The judge: found is what the robot has come to rest before, once a visit."""

import math

import numpy as np
import pytest

from dntorch.envs.judge import NOTHING, Judge, JudgeState

NEAR, FAR = math.radians(3), math.radians(9)


def found_at(judge, bearings, rates):
    """Steps at which a single block was found."""
    state, steps = JudgeState(), []
    for step, (bearing, rate) in enumerate(zip(bearings, rates, strict=True)):
        verdict, state = judge.step(np.array([bearing]), rate, state)
        if verdict.found != NOTHING:
            steps.append(step)
    return steps


def test_found_when_the_dwell_is_complete_and_only_once():
    assert found_at(Judge(), [NEAR] * 100, [0.0] * 100) == [15]


def test_not_found_outside_the_tolerance():
    assert found_at(Judge(), [FAR] * 100, [0.0] * 100) == []


def test_not_found_while_turning():
    assert found_at(Judge(), [NEAR] * 100, [0.25] * 100) == []


@pytest.mark.parametrize("sign", [1, -1])
def test_both_sides_and_both_directions_count_alike(sign):
    assert found_at(Judge(), [sign * NEAR] * 20, [sign * 0.09] * 20) == [15]
    assert found_at(Judge(), [sign * FAR] * 20, [0.0] * 20) == []
    assert found_at(Judge(), [NEAR] * 20, [sign * 0.11] * 20) == []


def test_a_break_in_the_dwell_starts_it_again():
    rates = [0.0] * 10 + [0.2] + [0.0] * 30
    assert found_at(Judge(), [NEAR] * 41, rates) == [26]


def test_a_visit_counts_again_only_after_leaving():
    still = [0.0] * 60
    assert found_at(Judge(), [NEAR] * 60, [0.0] * 20 + [0.2] * 5 + [0.0] * 35) == [15]
    assert found_at(Judge(), [NEAR] * 20 + [FAR] + [NEAR] * 39, still) == [15, 36]


def test_another_block_is_another_visit():
    judge, state, found = Judge(), JudgeState(), []
    for bearings in [(NEAR, FAR)] * 20 + [(FAR, NEAR)] * 20:
        verdict, state = judge.step(np.array(bearings), 0.0, state)
        found.append(verdict.found)
    assert [block for block in found if block != NOTHING] == [0, 1]
    assert found.index(1) == 35


def test_verdict_names_the_nearest_block():
    verdict, _ = Judge().step(np.array([0.3, -0.05, 0.2]), 1.0, JudgeState())
    assert verdict == (NOTHING, 1, -0.05)
    verdict, _ = Judge().step(np.array([0.3, -0.15, 0.2]), 1.0, JudgeState())
    assert verdict == (NOTHING, NOTHING, -0.15)


def test_dwell_is_counted_in_simulated_seconds():
    assert found_at(Judge(dt=1 / 64), [NEAR] * 100, [0.0] * 100) == [31]


@pytest.mark.parametrize("name", ["tolerance", "dwell", "dwell_rate", "dt"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_bad_arguments_are_named_with_a_remedy(name, value):
    with pytest.raises(ValueError, match=rf"{name}={value}.*give a number above 0"):
        Judge(**{name: value})

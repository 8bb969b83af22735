"""The task: reward after one order of colours, and only then."""

import pytest
import torch

from dntorch.envs.task import NOTHING, SequenceTask

COLORS = "RGBY"


def play(task, letters, gap=0, tail=0):
    """Rewards and completions, step by step, for letters found every ``gap + 1`` steps."""
    steps = []
    for letter in letters:
        steps += [COLORS.index(letter)] + [NOTHING] * gap
    state, rewards, completions = task.initial(), [], []
    for found in steps + [NOTHING] * tail:
        reward, completed, state = task.step(torch.tensor(found), state)
        rewards.append(float(reward))
        completions.append(bool(completed))
    return rewards, completions


def test_reward_starts_at_completion_and_lasts_its_duration():
    rewards, completions = play(SequenceTask(duration=0.25), "GBYRG", tail=10)
    assert completions == [False] * 4 + [True] + [False] * 10
    assert rewards == [0.0] * 4 + [2.0] * 8 + [0.0] * 3


def test_last_color_of_a_sequence_is_the_first_of_the_next():
    _, completions = play(SequenceTask(), "GBYRGBYRG", gap=3)
    assert sum(completions) == 2


@pytest.mark.parametrize("letters", ["GBYR", "BGYRG", "GBRYG", "GBYRB", "GBBYRG", "RGBYRYG"])
def test_another_order_is_not_rewarded(letters):
    rewards, completions = play(SequenceTask(), letters, gap=2, tail=40)
    assert not any(completions) and not any(rewards)


def test_what_came_before_does_not_matter():
    assert play(SequenceTask(), "RYGGBYRG")[1][-1]


def test_rows_of_a_batch_are_independent():
    task, letters = SequenceTask(duration=0.125), ["GBYRG", "GBYRY", "RGBYR"]
    state = task.initial((3,))
    for found in torch.tensor([[COLORS.index(x) for x in row] for row in letters]).T:
        reward, completed, state = task.step(found, state)
    assert completed.tolist() == [True, False, False]
    assert reward.tolist() == [2.0, 0.0, 0.0]
    assert state.remaining.tolist() == [3, 0, 0]


def test_step_is_pure():
    task = SequenceTask()
    state = task.initial((2,))
    before = [part.clone() for part in state]
    task.step(torch.tensor([1, NOTHING]), state)
    assert all(torch.equal(part, old) for part, old in zip(state, before, strict=True))


def test_duration_is_counted_in_simulated_seconds():
    assert SequenceTask(duration=1.0, dt=1 / 32).steps == 32
    assert SequenceTask(duration=1.0, dt=1 / 64).steps == 64


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"sequence": "GBX"}, ["sequence='GBX'", "'X'", "use letters"]),
        ({"sequence": "GGB"}, ["sequence='GGB'", "repeats 'G'", "put another"]),
        ({"sequence": "G"}, ["sequence='G'", "at least two"]),
        ({"colors": "RGBQ"}, ["colors='RGBQ'", "'Q'", "choose from"]),
        ({"colors": "RRGB"}, ["colors='RRGB'", "different letters"]),
        ({"duration": 0.001}, ["duration=0.001", "at least dt"]),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, words):
    with pytest.raises(ValueError) as error:
        SequenceTask(**arguments)
    assert all(word in str(error.value) for word in words)

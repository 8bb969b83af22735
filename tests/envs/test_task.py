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


def follow(task, letters):
    """Completions and progress after each letter, found one per step; "." finds nothing."""
    state, completions, progress = task.initial(), [], []
    for letter in letters:
        _, completed, state = task.step(torch.tensor(COLORS.find(letter)), state)
        completions.append(bool(completed))
        progress.append(round(float(task.progress(state)) * len(task.sequence)))
    return completions, progress


@pytest.mark.parametrize("step", [4, 5, 9, 10])
def test_the_sequence_changes_exactly_at_its_step(step):
    """GBYRG is completed by step number 5, RBGYR by step number 10, counted from 1."""
    completions, _ = follow(SequenceTask(then=("RBGYR", step)), "GBYRGRBGYR")
    assert completions[4] == (step > 4) and completions[9] == (step <= 9)
    assert sum(completions) == completions[4] + completions[9]


def test_after_the_change_only_the_second_sequence_is_rewarded_and_finds_count_on():
    task = SequenceTask("GBY", others=("YRG",), then=("RBG", 6), duration=1 / 16)
    assert task.targets.tolist() == [[1, 2, 3], [3, 0, 1], [0, 2, 1]]
    assert sum(follow(task, "GBYRGR")[0]) == 2  # both of the first
    assert sum(follow(task, "......GBYRG")[0]) == 0
    completions, progress = follow(task, "GBYRBRBG")
    assert completions == [False, False, True] + [False] * 4 + [True]
    assert progress == [1, 2, 3, 2, 0, 1, 2, 3]
    # R, found in the last step of the first sequence, is the first colour of the second.
    assert follow(task, "Y....RBG")[0][-1]


def test_the_age_is_counted_for_each_agent():
    task = SequenceTask("GB", then=("RY", 3))
    state = task.initial((2,))
    assert state.age.tolist() == [0, 0] and state.age.dtype == torch.int64
    state = state._replace(age=torch.tensor([0, 2]))
    done = []
    for letter in "RY":
        _, completed, state = task.step(torch.tensor([COLORS.index(letter)] * 2), state)
        done.append(completed.tolist())
    assert state.age.tolist() == [2, 4] and done == [[False, False], [False, True]]


def test_progress_is_how_many_of_the_last_finds_begin_the_sequence():
    _, progress = follow(SequenceTask(), "GBGBYRG.BYRGR..GG")
    assert progress == [1, 2, 1, 2, 3, 4, 5, 5, 2, 3, 4, 5, 0, 0, 0, 1, 1]
    assert follow(SequenceTask(), "....")[1] == [0] * 4
    assert follow(SequenceTask("GBG"), "GBGBGYG")[1] == [1, 2, 3, 2, 3, 0, 1]


def test_progress_is_of_the_furthest_sequence_and_of_each_agent():
    assert follow(SequenceTask("GBY", others=("RGB",)), "RGBYR")[1] == [1, 2, 3, 3, 1]
    task = SequenceTask("GBYR")
    state = task.initial((2, 3))
    assert torch.equal(task.progress(state), torch.zeros(2, 3))
    _, _, state = task.step(torch.tensor([[1, 2, NOTHING], [0, 1, 3]]), state)
    assert task.progress(state).tolist() == [[0.25, 0, 0], [0, 0.25, 0]]


def test_progress_is_of_the_sequence_rewarded_next():
    task = SequenceTask("GBY", then=("BRY", 3))
    assert follow(task, "GB...")[1] == [1, 2, 1, 1, 1]


def test_a_task_says_how_to_build_it_and_moves_whole():
    task = SequenceTask("GBY", others=("YRG",), then=("RBG", 6))
    assert repr(eval(repr(task))) == repr(task) != repr(SequenceTask("GBY", others=("YRG",)))
    there = task.to("meta")
    _, completed, state = there.step(torch.zeros(2, dtype=torch.int64, device="meta"),
                                     there.initial((2,)))  # fmt: skip
    assert completed.device.type == there.progress(state).device.type == "meta"
    assert task.targets.device.type == "cpu"


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"sequence": "GBX"}, ["sequence='GBX'", "'X'", "use letters"]),
        ({"sequence": "GGB"}, ["sequence='GGB'", "repeats 'G'", "put another"]),
        ({"sequence": "G"}, ["sequence='G'", "at least two"]),
        ({"colors": "RGBQ"}, ["colors='RGBQ'", "'Q'", "choose from"]),
        ({"colors": "RRGB"}, ["colors='RRGB'", "different letters"]),
        ({"duration": 0.001}, ["duration=0.001", "at least dt"]),
        ({"then": ("RBGY", 5)}, ["then=('RBGY', 5)", "give a sequence as long as 'GBYRG'"]),
        ({"then": ("RBGYX", 5)}, ["then=('RBGYX', 5)", "'X'", "use letters of colors"]),
        ({"then": (3, 5)}, ["then=(3, 5)", "give letters"]),
        ({"then": ("RBGYR", 0)}, ["then=('RBGYR', 0)", "give a whole number from 1"]),
        ({"then": ("RBGYR", 2.0)}, ["then=('RBGYR', 2.0)", "give a whole number from 1"]),
        ({"then": ("RBGYR", True)}, ["then=('RBGYR', True)", "give a whole number from 1"]),
        ({"then": ("RBGYR",)}, ["then=('RBGYR',)", "give (sequence, step)"]),
        ({"then": "RBGYR"}, ["then='RBGYR'", "give (sequence, step)"]),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, words):
    with pytest.raises(ValueError) as error:
        SequenceTask(**arguments)
    assert all(word in str(error.value) for word in words)

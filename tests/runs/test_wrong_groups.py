"""What makes no group and no run is refused in one sentence before a step."""

import math

import pytest

from dntorch import files
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.run import Run, Trial

CONFIG = Config(world="nodes", steps=20, explore=10)


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"agents": (1, 2), "seeds": (1,)}, "seeds"),
        ({"agents": 3}, "agents"),
        ({"agents": (-1,)}, "agents"),
        ({"agents": (2**40,)}, "agents"),
        ({"seeds": (1.5,)}, "seeds"),
        ({"seeds": (-1,)}, "seeds"),
        ({"seeds": (1,), "rows": (1, 2, 3)}, "rows"),
        ({"seeds": (1,), "parameters": {"noise": (1.0, 2.0)}}, "noise"),
        ({"parameters": {"noise": (1.0,)}}, "noise"),
        ({"seeds": (1,), "parameters": {"noise": (-1.0,)}}, "noise"),
        ({"seeds": (1,), "parameters": {"reward": (math.nan,)}}, "reward"),
        ({"seeds": (1,), "parameters": {"reward_duration": (1e-9,)}}, "reward_duration"),
        ({"seeds": (1,), "parameters": {"planet": (1.0,)}}, "parameters"),
        ({"seeds": (1,), "parameters": {"learner.trace.planet": (1.0,)}}, "parameters"),
        ({"seeds": (1,), "parameters": {"learner.planet.tau": (1.0,)}}, "parameters"),
    ],
)
def test_numbers_that_are_not_one_for_each_agent_are_refused(arguments, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}=.*give") as error:
        Run(Group(CONFIG, **arguments))
    assert "\n" not in str(error.value)


def test_what_is_no_config_is_refused() -> None:
    for wrong in ("x", None, {"seed": 3}):
        with pytest.raises(ValueError, match=r"is no config: give Config\("):
            Run(wrong)
    with pytest.raises(ValueError, match=r"is no config: give Config\("):
        Trial(Group(CONFIG, seeds=(1, 2)))
    with pytest.raises(ValueError, match="give at least one"):
        Group.of(())


@pytest.mark.parametrize("steps", [-1, 2.5, "x", None])
def test_a_run_takes_whole_steps_forward(steps) -> None:
    run = Run(CONFIG)
    with pytest.raises(ValueError, match=r"steps=.*: give a whole number, 0 or more"):
        run.advance(steps)
    assert run.step == 0


def test_a_member_that_is_not_there_is_refused() -> None:
    two = Group(CONFIG, seeds=(1, 2))
    for run, k in ((Run(CONFIG), 0), (Run(two), 2), (Run(two), -1), (Run(two, events=True), 0)):
        with pytest.raises(ValueError, match=f"k={k}: give a place in the batch"):
            run.member(k)


def test_a_path_may_be_a_text(tmp_path) -> None:
    run = Trial(CONFIG)
    run.advance(5)
    run.save(str(tmp_path / "c.pt"))
    assert Trial.load(str(tmp_path / "c.pt")).step == 5
    assert files.load(str(tmp_path / "c.pt"))["step"] == 5

"""What a policy and the worlds of TorchRL refuse, and leave as it was."""

import math

import pytest
import torch

pytest.importorskip("torchrl")

from dntorch import DNSarsa, Exploration
from dntorch.envs import NodesWorld, RingEnv, RingWorld
from dntorch.rl import AgentPolicy, WorldEnv, transformed


@pytest.mark.parametrize("explore", [-1, "x", None, math.nan])
def test_steps_of_exploration_that_are_none_are_refused(explore) -> None:
    with pytest.raises(ValueError, match=r"explore=.*: give a number of steps, 0 or more"):
        AgentPolicy(DNSarsa(2), explore, Exploration(2, 0))
    with pytest.raises(ValueError, match=r"exploration='x' is no .*: give Exploration\("):
        AgentPolicy(DNSarsa(2), exploration="x")


def test_a_gymnasium_env_is_not_transformed_but_wrapped() -> None:
    with pytest.raises(ValueError, match=r"use wrap\(env\)"):
        transformed(RingEnv())


@pytest.mark.parametrize("state", [{}, {"seeds": torch.zeros(2), "state": None}])
def test_a_snapshot_of_another_world_or_batch_leaves_the_env_as_it_was(state) -> None:
    other = WorldEnv(NodesWorld(), (4,), seed=3)
    env = WorldEnv(NodesWorld(), (2,))
    for wrong in (state, other.state_dict(), WorldEnv(RingWorld(), (2,)).state_dict()):
        with pytest.raises(ValueError, match=r"give what|it was taken of"):
            env.load_state_dict(wrong)
    with pytest.raises(ValueError, match="seed="):
        env.set_seed(-1)
    assert env.seeds.tolist() == [0, 0] and env.state.target.shape == (2,)
    assert env.rollout(3)["next", "reward"].shape == (2, 3, 1)

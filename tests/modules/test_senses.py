"""Observations by name, from worlds that compute only what is read to agents of mixed senses."""

from typing import NamedTuple

import numpy as np
import pytest
import torch
from needs import EPUCK, needs
from robot_worlds import Setup
from tensordict import TensorDict
from torch import Tensor

from dntorch import DNSarsa, FindColor, Repertoire, Sensorimotor
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.envs import EPuckEnv, HardwareEnv, RingEnv, sensors
from dntorch.envs.adaptor import tensors
from dntorch.modules.sensorimotor import Direct
from dntorch.rl import AgentPolicy
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial, load_trained
from dntorch.runs.worlds import build_world

SPEED = 0.8


class NearState(NamedTuple):
    u: Tensor


class Near(Sensorimotor[NearState]):
    """Two behaviours without a camera: back off from what is near, and drive to it."""

    senses = ("proximity",)

    def __init__(self) -> None:
        super().__init__(max_speed=SPEED)
        self.n = 2
        self.register_buffer("u", torch.zeros(8), persistent=False)

    def initial(self, batch: list[int]) -> NearState:
        return NearState(self.origin.new_zeros([*batch, 8]))

    def match(self, observation: dict[str, Tensor], state: NearState) -> Tensor:
        near = state.u.amax(-1)
        return torch.stack((1 - near, near), -1)

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: NearState
    ) -> NearState:
        return NearState(state.u.lerp((observation["proximity"] / 1000).clamp(0, 1), 0.5))

    def act(self, intention: Tensor, state: NearState) -> Tensor:
        ahead = 9.0 * (intention[..., 1:] - intention[..., :1])  # far more than it may
        return torch.cat((ahead, ahead), -1)


def mixed() -> DNSarsa:
    return DNSarsa(6, Repertoire(FindColor("RGBY"), Near()))


def forbid(monkeypatch, *names: str) -> None:
    def computed(*_):
        raise AssertionError("nobody reads this")

    for name in names:
        monkeypatch.setattr(sensors, name, computed)


# ------------------------------------------------------------------ worlds


@needs("pybullet")
@pytest.mark.parametrize("senses, idle", [
    (("image",), ["proximity"]), (("proximity", "wheels"), ["image"]),
    ((), ["image", "proximity"]),
])  # fmt: skip
def test_what_nobody_reads_is_not_computed(senses, idle, monkeypatch) -> None:
    forbid(monkeypatch, *idle)
    env = EPuckEnv(pivot="kinematic", senses=senses)
    for observation in (env.reset(seed=0)[0], env.step(np.zeros(2))[0]):
        assert observation.keys() == set(senses) and env.observation_space.contains(observation)
    env.close()


@needs("pybullet")
def test_a_sense_is_the_same_with_and_without_the_others() -> None:
    whole, part = EPuckEnv(pivot="kinematic"), EPuckEnv(pivot="kinematic", senses=("proximity",))
    assert np.array_equal(whole.reset(seed=0)[0]["proximity"], part.reset(seed=0)[0]["proximity"])
    whole.step(np.array([1.0, -1.0]))
    part.load_state_dict(whole.state_dict())  # other senses, the same world
    assert part.pose.yaw == whole.pose.yaw
    assert np.array_equal(part.sense("image"), whole.observe()["image"])
    whole.close()
    part.close()


@pytest.mark.parametrize("senses", ["image", ("image", "radar")])
def test_an_unknown_sense_is_one_sentence(senses) -> None:
    with pytest.raises(ValueError, match=r"is unknown, give a tuple out of \('image', 'wheels'"):
        RingEnv(senses=senses)
    setup = Setup()
    with pytest.raises(ValueError, match=r"is unknown, give a tuple out of \('image', 'wheels'"):
        HardwareEnv(setup.driver, setup.clock, senses=senses)


def test_a_robot_shows_the_senses_that_are_read() -> None:
    setup = Setup()
    env = HardwareEnv(setup.driver, setup.clock, senses=("proximity",))
    assert env.reset()[0].keys() == {"proximity"} == env.observation_space.keys()
    env.close()


@needs("pybullet")
def test_a_run_shows_its_agent_what_the_agent_reads(monkeypatch) -> None:
    forbid(monkeypatch, "proximity")
    trial = Trial(Config(steps=2, explore=0))
    trial.advance(2)
    assert trial.engine.moment.observation.keys() == {"image"}
    trial.close()
    world = build_world(Config(world="nodes"), ("match",))
    assert world.observe(world.initial()).keys() == {"match"}
    with pytest.raises(ValueError, match=r"'image' is unknown, give a tuple of"):
        build_world(Config(world="nodes"), ("image",))


def test_a_run_of_an_older_version_is_refused_in_a_sentence(tmp_path, monkeypatch) -> None:
    path = tmp_path / "checkpoint.pt"
    monkeypatch.setattr("dntorch.files.FORMAT", 1)
    Trial(Config(world="nodes", steps=2, explore=0)).save(path)
    monkeypatch.undo()
    for load in (Trial.load, load_trained):
        with pytest.raises(ValueError, match="another version of dntorch, format 1 instead of 3"):
            load(path)


# ------------------------------------------------------------------ several kinds of behaviour


def test_a_body_of_two_kinds_is_limited_once() -> None:
    body = mixed().sensorimotor
    assert body.senses == ("image", "proximity") and body.n == 6 and body.max_speed == SPEED
    image = torch.zeros(39, 52, 3, dtype=torch.uint8)
    image[10:30, 5:15, 2] = 255
    seen = {"image": image, "proximity": torch.zeros(8)}
    both = torch.tensor([0.0, 0.0, 1.0, 0.0, 0.0, 1.0])  # find blue, on the left; drive ahead
    for _ in range(32):
        action = body(seen, both)
    turning, driving = (
        part.act(wanted, part.state) for part, wanted in zip(body.parts, (both[:4], both[4:]))
    )
    assert turning[0] < -0.1 and driving[0] == 9
    assert action.tolist() == pytest.approx([SPEED, SPEED])  # not less on the left


def test_an_agent_with_two_senses_lives_in_the_world() -> None:
    agent, none = mixed(), torch.zeros(6)
    env = RingEnv(senses=agent.senses)
    (seen, _), reward, fastest = env.reset(seed=0), 0.0, 0.0
    with torch.no_grad():
        for _ in range(120):
            assert seen.keys() == set(agent.senses) == {"image", "proximity"}
            action = agent(tensors(seen), torch.tensor(reward), none)
            intention, _ = agent.behaviors.output(agent.behaviors.state)
            body = agent.sensorimotor
            wanted = body.act(intention, body.state)
            assert torch.equal(action, wanted.clamp(-SPEED, SPEED))
            fastest = max(fastest, float(wanted.abs().max()))
            seen, reward, *_ = env.step(action.numpy())
    env.close()
    assert fastest > 2 * SPEED
    with pytest.raises(ValueError, match="the observation lacks 'proximity'"):
        agent({"image": tensors(seen)["image"]}, torch.tensor(0.0), none)


@pytest.mark.parametrize("carried", [False, True], ids=["buffers", "tensordict"])
@pytest.mark.parametrize("world", ["ring", EPUCK])
def test_two_senses_through_torchrl_equal_the_plain_loop(world: str, carried: bool) -> None:
    agent, alone = mixed(), mixed()
    policy = AgentPolicy(agent, carried=carried)
    assert policy.in_keys[:4] == ["image", "proximity", "last_reward", "is_init"]
    config = Config(world=world, seed=3)
    env = collected(config, policy.primer() if carried else None, senses=agent.senses)
    batch = env.rollout(60, policy)
    assert {"image", "proximity"} <= set(batch.keys()) and "wheels" not in batch.keys()
    world, reward = build_world(config, alone.senses), torch.zeros(())
    place = world.initial(seed=config.seed)
    seen = world.observe(place)
    for k in range(60):
        assert torch.equal(seen["proximity"], batch["proximity"][k])
        action = alone(seen, reward, torch.zeros(6))
        assert torch.equal(action, batch["action"][k])
        outcome, place = world.step(action, place)
        seen, reward = outcome.observation, outcome.reward
    world.close()
    env.close()
    assert batch["action"].abs().max() == pytest.approx(SPEED)


def test_a_key_that_is_missing_is_named_with_a_remedy() -> None:
    policy = AgentPolicy(mixed())
    env = collected(Config(world="ring"))
    with pytest.raises(KeyError, match=r"lacks 'proximity': .*senses=agent.senses"):
        policy(env.reset())
    env.close()
    shown = TensorDict({"match": torch.zeros(2)})
    with pytest.raises(KeyError, match=r"lacks 'is_init': make the env with wrap or transformed"):
        AgentPolicy(DNSarsa(2))(shown)


# ------------------------------------------------------------------ numbers that are none


@pytest.mark.parametrize("carried", [False, True], ids=["buffers", "tensordict"])
@pytest.mark.parametrize("first", [False, True], ids=["within", "terminal"])
@pytest.mark.parametrize("bad", [torch.nan, torch.inf])
def test_a_reward_of_nan_is_counted_and_teaches_nothing(bad, first: bool, carried: bool) -> None:
    agent = DNSarsa(2)
    learner = agent.state.learner._replace(trace=WorkingMemoryState(torch.full((2, 2), 0.4)))
    agent.state = agent.state._replace(learner=learner)
    policy = AgentPolicy(agent, carried=carried)
    config = Config(world="nodes", colors="GB", sequence="GB")
    env = collected(config, policy.primer() if carried else None)
    shown = env.reset()
    shown["last_reward"].fill_(bad)
    shown["is_init"].fill_(first)
    done = policy(shown)
    if carried:
        policy.adopt(torch.stack([done]))
    assert agent.ignored == 1 and not agent.weights.any()
    assert all(x.isfinite().all() for x in agent.snapshot().values())


class Blind(Direct):
    """Its own arithmetic makes a number that is none."""

    def match(self, observation: dict[str, Tensor], state: dict[str, Tensor]) -> Tensor:
        return observation["match"] / 0


@pytest.mark.parametrize("seen", [0.0, 1.0], ids=["nan", "inf"])
def test_a_match_of_ones_own_that_is_none_teaches_nothing(seen: float) -> None:
    agent = DNSarsa(2, Blind())
    learner = agent.state.learner._replace(trace=WorkingMemoryState(torch.full((2, 2), 0.4)))
    agent.state = agent.state._replace(learner=learner)
    for _ in range(100):
        agent({"match": torch.full((2,), seen)}, torch.tensor(1.0), torch.zeros(2))
    assert all(x.isfinite().all() for x in agent.snapshot().values()) and agent.weights.any()

"""The agent as a TorchRL policy: the numbers of the plain loop, and nothing lost on the way."""

import pickle
from collections import deque
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase, StepCounter, check_env_specs

from dntorch import DNSarsa, Exploration, files
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.rl import AgentPolicy, AgentPrimer, wrap
from dntorch.rl.transforms import world_of
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial

FORMS = pytest.mark.parametrize("carried", [False, True], ids=["buffers", "tensordict"])
WORLD = pytest.mark.parametrize("world", ["nodes", "epuck"])


def collector(env: EnvBase, policy: AgentPolicy, frames: int, total: int = -1):
    from torchrl.collectors import Collector

    return Collector(env, policy, frames_per_batch=frames, total_frames=total)


def build(config: Config, carried: bool = False) -> tuple[EnvBase, AgentPolicy]:
    agent, exploration = build_agent(config), build_exploration(config)
    policy = AgentPolicy(agent, config.explore, exploration, carried)
    return collected(config, policy.primer() if carried else None), policy


@FORMS
@WORLD
def test_a_collector_learns_what_the_plain_loop_learns(world: str, carried: bool) -> None:
    config = Config(world=world, steps=480, explore=300, seed=1, sequence="GB", colors="GB")
    trial = Trial(config)
    trial.advance(480)
    assert trial.agent.weights.abs().max() > 0.05  # rewarded
    env, policy = build(config, carried)
    before = policy.agent.snapshot()
    batches = [batch.clone() for batch in collector(env, policy, 120, 480)]
    record = torch.cat(batches)
    if carried:  # the agent itself was only read
        assert all(torch.equal(v, before[k]) for k, v in policy.agent.snapshot().items())
        policy.adopt(batches[-1])
    ours, theirs = policy.agent.snapshot(), trial.agent.snapshot()
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    assert policy.steps == 480
    arrays = trial.record.arrays()
    for name in ("intention", "satisfaction", "trace", "error"):
        assert np.array_equal(record[name].numpy(), arrays[name]), name
    assert np.array_equal(record["weights"][::100].numpy(), arrays["weights"])
    assert np.array_equal(record["next", "found"].numpy(), arrays["found"])
    assert np.array_equal(record["next", "reward"][:, 0].numpy(), arrays["reward"])
    assert record["steps"].tolist() == list(range(1, 481))


@WORLD
def test_building_a_collector_steps_no_agent(world: str) -> None:
    env, policy = build(Config(world=world))
    before = policy.agent.snapshot()
    collector(env, policy, 10).shutdown()
    assert policy.steps == 0
    assert all(torch.equal(v, before[k]) for k, v in policy.agent.snapshot().items())


@FORMS
@WORLD
def test_specs(world: str, carried: bool) -> None:
    env, _ = build(Config(world=world), carried)
    check_env_specs(env)
    env.append_transform(StepCounter(max_steps=2))
    check_env_specs(env)


def test_what_the_world_of_a_run_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match=r"agents=2: world='epuck' is for one agent"):
        collected(Config(), agents=2)
    with pytest.raises(
        ValueError, match=r"senses=\('image',\): 'image' is unknown, give a tuple of \('match',\)"
    ):
        collected(Config(world="nodes"), senses=["image"])


def test_specs_of_a_batch() -> None:
    env = collected(Config(world="nodes"), agents=torch.arange(3))
    check_env_specs(env)
    assert env.rollout(5).shape == (3, 5)


# ------------------------------------------------------------------ batches


def test_rows_of_a_native_batch_are_what_agents_alone_are() -> None:
    config = Config(world="nodes", seed=5, explore=300, sequence="GB", colors="GBY")
    numbers = torch.arange(4)
    policy = AgentPolicy(DNSarsa(3).spread(4), 300, Exploration(3, 5, numbers))
    batch = next(iter(collector(collected(config, agents=numbers), policy, 4 * 450)))
    for k in range(4):
        alone = AgentPolicy(DNSarsa(3), 300, Exploration(3, 5, k))
        one = next(iter(collector(collected(config, agents=k), alone, 450)))
        assert torch.equal(one["next", "found"], batch["next", "found"][k])
        assert torch.allclose(one["weights"], batch["weights"][k], atol=1e-4)
    assert (batch["next", "found"] >= 0).sum() > 8


def test_a_batch_that_would_share_its_values_is_refused() -> None:
    with pytest.raises(ValueError, match=r"agent.spread"):
        AgentPolicy(DNSarsa(2).resize(3))


# ------------------------------------------------------------------ episodes


class Bell(gymnasium.Env):
    """Ends every third step; the reward is the number of the step, also of the last one."""

    observation_space = gymnasium.spaces.Dict(
        {"match": gymnasium.spaces.Box(0, 1, (2,), np.float32)}
    )
    action_space = gymnasium.spaces.Box(0, 1, (2,), np.float32)
    count = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return {"match": np.zeros(2, np.float32)}, {}

    def step(self, action):
        self.count += 1
        ended = self.count % 3 == 0
        return {"match": np.zeros(2, np.float32)}, float(self.count), ended, False, {}


def test_the_policy_sees_every_reward_once_the_terminal_one_included() -> None:
    policy = AgentPolicy(DNSarsa(2))
    batch = next(iter(collector(wrap(Bell()), policy, 10)))
    assert batch["last_reward"][:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    assert batch["is_init"][:, 0].tolist() == [k % 3 == 0 for k in range(10)]


def test_a_terminal_reward_is_learned_with_the_trace_that_earned_it() -> None:
    agent = DNSarsa(2)
    policy = AgentPolicy(agent)
    trace = torch.tensor([[0.0, 0.6], [0.3, 0.0]])
    learner = agent.state.learner._replace(trace=WorkingMemoryState(trace))
    agent.state = agent.state._replace(learner=learner)
    shown = {"match": torch.zeros(2), "last_reward": torch.tensor([2.0])}
    policy(TensorDict(shown | {"is_init": torch.tensor([True])}))
    learned = agent.learner.values.learning_rate / 32 * 2.0 * trace
    torch.testing.assert_close(agent.weights, learned)
    assert not agent.state.learner.trace.u.any()  # at rest: the same reward teaches once
    policy(TensorDict(shown | {"is_init": torch.tensor([False])}))
    torch.testing.assert_close(agent.weights, learned)


@FORMS
def test_a_reset_forgets_the_activation_and_keeps_what_was_learned(carried: bool) -> None:
    config = Config(world="nodes", seed=1, explore=10_000)
    env, policy = build(config, carried)
    env.append_transform(StepCounter(max_steps=300))
    with torch.no_grad():
        policy.agent.weights.fill_(0.5)
    if carried:
        env = collected(config, policy.primer()).append_transform(StepCounter(max_steps=300))
    batch = next(iter(collector(env, policy, 700)))
    first = batch["is_init"][:, 0].nonzero()[:, 0].tolist()
    assert first == [0, 300, 600]
    assert (batch["satisfaction"][299] > 0.5).any()  # busy before, at rest after
    assert not (batch["satisfaction"][300] > 0.5).any()
    assert torch.equal(batch["weights"][300], batch["weights"][299])
    assert batch["steps"].tolist() == list(range(1, 701))


def test_exploration_does_not_repeat_itself_in_each_episode() -> None:
    env, policy = build(
        Config(world="nodes", seed=1, explore=10_000, colors="ROYGCBVM", sequence="RO")
    )
    env.append_transform(StepCounter(max_steps=600))
    found = next(iter(collector(env, policy, 2400)))["next", "found"].view(4, 600)
    orders = {tuple(row[row >= 0].tolist()) for row in found}
    assert len(orders) > 1


def test_noise_ends_after_the_steps_of_exploration() -> None:
    loud = AgentPolicy(DNSarsa(2), 3, Exploration(2, 0))
    drawn = [float(loud._noise(torch.tensor(0), torch.tensor(k)).sum()) for k in range(5)]
    assert all(drawn[:3]) and not any(drawn[3:])
    mixed = AgentPolicy(DNSarsa(2).spread(2), 3, Exploration(2, 0, [0, 1]))
    rows = mixed._noise(torch.tensor([0, 0]), torch.tensor([2, 3])).sum((1, 2))
    assert rows[0] > 0 and rows[1] == 0


# ------------------------------------------------------------------ what must not pass in silence


def test_a_state_that_nobody_carries_is_refused() -> None:
    env, _ = build(Config(world="nodes"))
    policy = build(Config(world="nodes"), carried=True)[1]
    with pytest.raises(KeyError, match=r"append policy.primer\(\)"):
        policy(env.reset())


def test_a_stateful_policy_in_shared_memory_is_refused() -> None:
    env, policy = build(Config(world="nodes"))
    policy.share_memory()
    with pytest.raises(RuntimeError, match=r"policy_factory=.*or build it with carried=True"):
        policy(env.reset())


def test_a_shared_policy_whose_state_is_carried_works() -> None:
    env, policy = build(Config(world="nodes"), carried=True)
    policy.share_memory()
    assert policy(env.reset())["steps"] == 1


def test_exploration_without_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="explore=5 needs exploration"):
        AgentPolicy(DNSarsa(2), explore=5)


# ------------------------------------------------------------------ checkpoints


def advance(collector, batches: int) -> TensorDictBase:
    iterator = iter(collector)
    return torch.cat([next(iterator).clone() for _ in range(batches)])


@FORMS
@WORLD
def test_a_collector_resumes_to_the_same_numbers(world: str, carried: bool, tmp_path: Path) -> None:
    config = Config(world=world, steps=240, explore=150, seed=4)
    env, policy = build(config, carried)
    whole = advance(collector(env, policy, 60), 4)

    first = collector(*build(config, carried), 60)
    advance(first, 2)
    files.save(tmp_path / "c.pt", {"collector": first.state_dict()})
    first.shutdown()
    second = collector(*build(config, carried), 60)
    second.load_state_dict(files.load(tmp_path / "c.pt")["collector"])
    rest = advance(second, 2)
    for name in ("action", "intention", "weights", "steps", "is_init", ("next", "found")):
        assert torch.equal(rest[name], whole[name][120:]), name


@WORLD
def test_a_world_that_could_not_be_loaded_again_is_refused_at_the_save(world: str) -> None:
    made = collector(*build(Config(world=world)), 10)
    advance(made, 1)
    base = world_of(made.env)
    state_dict = base.state_dict
    base.state_dict = lambda: state_dict() | {"extra": deque([1])}
    with pytest.raises(ValueError, match=r"world\.extra is a deque: give numbers"):
        made.state_dict()
    made.shutdown()


def staggered(config: Config, carried: bool):
    """Three agents whose episodes end at different times: each reset but the first is partial."""
    numbers = torch.arange(3)
    agent, noise = DNSarsa(3).spread(3), Exploration(3, config.seed, numbers)
    policy = AgentPolicy(agent, config.explore, noise, carried)
    env = collected(config, policy.primer() if carried else None, agents=numbers)
    env.insert_transform(0, StepCounter(max_steps=40))
    made = collector(env, policy, 3 * 25)
    made.reset(index=[1])  # it counts from here
    return made


@FORMS
def test_a_collector_resumes_after_a_reset_of_a_part_of_the_batch(carried: bool) -> None:
    config = Config(world="nodes", seed=2, explore=400, sequence="GB", colors="GBY")
    first = staggered(config, carried)
    iterator = iter(first)
    next(iterator)
    first.reset(index=[2])  # nobody has stepped since this one
    state = pickle.loads(pickle.dumps(first.state_dict()))
    whole = torch.cat([next(iterator).clone() for _ in range(4)], -1)
    begun = whole["is_init"][..., 0].sum(0)
    assert set(begun.tolist()) == {0, 1, 2}  # never all at once
    assert whole["is_init"][2, 0] and not whole["is_init"][:2, 0].any()

    second = staggered(config, carried)
    second.load_state_dict(state)
    iterator = iter(second)
    rest = torch.cat([next(iterator).clone() for _ in range(4)], -1)
    for name in ("action", "intention", "weights", "steps", "is_init", ("next", "found")):
        assert torch.equal(rest[name], whole[name]), name


def test_a_primer_forgets_when_it_is_told_to() -> None:
    env, policy = build(Config(world="nodes"), carried=True)
    env.rollout(20, policy)
    primer = next(t for t in env.transform if isinstance(t, AgentPrimer))
    assert env.reset()["agent", "steps"] == 20
    primer.forget()
    assert env.reset()["agent", "steps"] == 0


# ------------------------------------------------------------------ logging


@pytest.mark.parametrize("kind", ["csv", "tensorboard"])
def test_a_run_is_logged_with_torchrl(kind: str, tmp_path: Path) -> None:
    from dntorch.runs.logs import open_log
    from dntorch.runs.train import train

    trial, log = Trial(Config(world="nodes", steps=200, explore=200)), open_log(kind, tmp_path)
    train(trial, tmp_path / "c.pt", progress=log)
    files = {path.name: path for path in (tmp_path / "log").rglob("*") if path.is_file()}
    if kind == "csv":
        lines = files["behaviors.csv"].read_text().split()
        assert lines[-1] == f"200,{float(len(trial.record.behaviors))}"
    else:
        assert any("tfevents" in name for name in files)

"""The agent as a TorchRL policy: the numbers of the plain loop, and nothing lost on the way."""

import copy
import pickle
from collections import deque
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from needs import EPUCK, needs
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import (
    EnvBase,
    GymWrapper,
    InitTracker,
    RenameTransform,
    RewardScaling,
    StepCounter,
    TransformedEnv,
    check_env_specs,
)

from dntorch import DNSarsa, Exploration, FindColor, files
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.rl import AgentPolicy, AgentPrimer, LastReward, wrap
from dntorch.rl.transforms import world_of
from dntorch.runs.build import build_agent, build_exploration
from dntorch.runs.collect import collected
from dntorch.runs.config import Config
from dntorch.runs.run import Trial

FORMS = pytest.mark.parametrize("carried", [False, True], ids=["buffers", "tensordict"])
WORLD = pytest.mark.parametrize("world", ["nodes", EPUCK])


def collector(env: EnvBase, policy: AgentPolicy, frames: int, total: int = -1, **others):
    from torchrl.collectors import Collector

    return Collector(env, policy, frames_per_batch=frames, total_frames=total, **others)


def build(config: Config, carried: bool = False) -> tuple[EnvBase, AgentPolicy]:
    agent, exploration = build_agent(config), build_exploration(config)
    policy = AgentPolicy(agent, config.explore, exploration, carried)
    return collected(config, policy.primer() if carried else None), policy


PARTS = {
    "recall": 1, "habituation": 2, "patience": 4.0, "constraints": 20.0, "curiosity": 4.0,
}  # fmt: skip
"""Numbers of an agent with every part that it may have."""
EACH = [
    pytest.param("nodes", {}, id="nodes"),
    pytest.param("epuck", {}, id="epuck", marks=EPUCK.marks),
    pytest.param("nodes", {"seed": 2} | PARTS, id="parts"),
]
AT_ONCE = PARTS | {"recall": 0}
"""Failures teach after the first completion: with recall it takes two to make a state."""


@FORMS
@pytest.mark.parametrize(("world", "parts"), EACH)
def test_a_collector_learns_what_the_plain_loop_learns(
    world: str, parts: dict, carried: bool
) -> None:
    common = {"steps": 480, "explore": 300, "seed": 1, "sequence": "GB", "colors": "GB"}
    config = Config(world=world, **common | parts)
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
    assert not parts or (trial.agent.failures > 0 and record["lamp"].max() == 1)
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


@needs("pybullet")
def test_what_the_world_of_a_run_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match=r"agents=2: world='epuck' is for one agent"):
        collected(Config(), agents=2)
    with pytest.raises(
        ValueError, match=r"senses=\('image',\): 'image' is unknown, give a tuple of \('match', "
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
    """Ends every third step, if it ends; the reward is the number of the step, always."""

    observation_space = gymnasium.spaces.Dict(
        {"match": gymnasium.spaces.Box(0, 1, (2,), np.float32)}
    )
    action_space = gymnasium.spaces.Box(0, 1, (2,), np.float32)
    count = 0

    def __init__(self, ends=True):
        self.ends = ends

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return {"match": np.zeros(2, np.float32)}, {}

    def step(self, action):
        self.count += 1
        ended = self.ends and self.count % 3 == 0
        return {"match": np.zeros(2, np.float32)}, float(self.count), ended, False, {}


def test_the_policy_sees_every_reward_once_the_terminal_one_included() -> None:
    policy = AgentPolicy(DNSarsa(2))
    batch = next(iter(collector(wrap(Bell()), policy, 10)))
    assert batch["last_reward"][:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    assert batch["is_init"][:, 0].tolist() == [k % 3 == 0 for k in range(10)]


#: Ways to cut episodes: what is done to the env, arguments of the collector.
CUTS = {
    "appended": (lambda env, steps: env.append_transform(StepCounter(steps)), ()),
    "inserted": (lambda env, steps: env.insert_transform(0, StepCounter(steps)), ()),
    "wrapped": (lambda env, steps: TransformedEnv(env, StepCounter(steps)), ()),
    "max_frames_per_traj": (lambda env, _: env, ("max_frames_per_traj",)),
}
cuts = pytest.mark.parametrize("cut", CUTS)
unwrapped = pytest.mark.filterwarnings("ignore:Nested TransformedEnvs are automatically unwrapped")


def cut_collector(cut: str, env: EnvBase, policy: AgentPolicy, steps: int, frames: int, **others):
    change, names = CUTS[cut]
    return collector(change(env, steps), policy, frames, **dict.fromkeys(names, steps), **others)


@cuts
@unwrapped
def test_the_last_reward_of_an_episode_arrives_whoever_cuts_it(cut: str) -> None:
    policy = AgentPolicy(DNSarsa(2))
    batch = next(iter(cut_collector(cut, wrap(Bell(ends=False)), policy, 3, 10)))
    assert batch["last_reward"][:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    assert batch["is_init"][:, 0].tolist() == [k % 3 == 0 for k in range(10)]


def test_the_last_reward_arrives_when_the_collector_begins_each_batch_anew() -> None:
    env, policy = wrap(Bell(ends=False)), AgentPolicy(DNSarsa(2))
    made = iter(collector(env, policy, 4, reset_at_each_iter=True))
    batches = torch.stack([next(made).clone() for _ in range(3)])
    assert batches["last_reward"][..., 0].flatten().tolist() == list(range(12))
    assert batches["is_init"][:, 0].all()


def test_the_agent_sees_the_reward_as_it_is_recorded_whatever_changes_it() -> None:
    env = wrap(Bell()).append_transform(RewardScaling(0.0, 2.0))
    batch = next(iter(collector(env, AgentPolicy(DNSarsa(2)), 10)))
    assert batch["last_reward"][:, 0].tolist() == [0, 2, 4, 6, 8, 10, 12, 14, 16, 18]
    assert torch.equal(batch["next", "reward"], batch["next", "last_reward"])


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
@pytest.mark.parametrize("parts", [{"seed": 1}, {"seed": 5} | AT_ONCE], ids=["plain", "parts"])
def test_a_reset_forgets_the_activation_and_keeps_what_was_learned(
    carried: bool, parts: dict
) -> None:
    config = Config(world="nodes", explore=10_000, **parts)
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
    if carried:
        policy.adopt(batch)
    learned = policy.agent.state_dict()
    assert len(learned) == (1 if len(parts) == 1 else 3) and all(
        each.any() for each in learned.values()
    )


@FORMS
def test_what_every_part_learned_outlives_an_episode(carried: bool) -> None:
    """Long-term memory of all parts is the same before and after the step that begins one."""
    config = Config(world="nodes", seed=1, explore=10_000, **AT_ONCE)
    env, policy = build(config, carried)
    with torch.no_grad():
        tensordict = env.rollout(400, policy)[-1]["next"].exclude("reward", "done", "terminated")
        learned = held(policy, tensordict)
        assert len(learned) == 3 and learned["deliberation.constraints.suppression"].any()
        assert learned["deliberation.curiosity.weights"].any()
        shown = tensordict.clone().set("is_init", torch.ones(1, dtype=torch.bool))
        after = policy(shown.set("last_reward", torch.zeros(1)))
    if carried:
        after = after["next"]
    for name, value in held(policy, after).items():
        torch.testing.assert_close(value, learned[name], rtol=1e-4, atol=0)  # a step fades a little


def held(policy: AgentPolicy, tensordict: TensorDictBase) -> dict[str, torch.Tensor]:
    """What an agent has learned, wherever it lies."""
    names = policy.agent.state_dict().keys()
    place = tensordict["agent"] if policy.carried else dict(policy.agent.named_buffers())
    return {name: place[name].clone() for name in names}


@FORMS
def test_a_batch_with_every_part_steps(carried: bool) -> None:
    config = Config(world="nodes", seed=1, explore=10_000, **PARTS)
    agent, noise = build_agent(config).spread(3), Exploration(4, 1, range(3))
    policy = AgentPolicy(agent, 10_000, noise, carried)
    primer = policy.primer() if carried else None
    env = collected(config, primer, agents=torch.arange(3))
    check_env_specs(env)
    batch = next(iter(collector(env, policy, 3 * 800)))
    assert batch["weights"].shape == (3, 800, 4, 16) and batch["lamp"].shape == (3, 800, 1)
    assert (batch["next", "found"] >= 0).any(1).all()


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
    rows = mixed._noise(torch.tensor([0, 0]), torch.tensor([2, 3])).sum(1)
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
    policy = AgentPolicy(DNSarsa(2))
    policy.explore = 5
    with pytest.raises(ValueError, match="explore=5 needs exploration"):
        wrap(Bell()).rollout(2, policy)


@pytest.mark.parametrize("agent", [5, None, DNSarsa, Exploration(2, 0)])
def test_what_is_no_agent_is_refused(agent: object) -> None:
    with pytest.raises(TypeError, match=r"agent is a \w+: give a DNSarsa"):
        AgentPolicy(agent)


class Other(Bell):
    """The same observation under a name that no agent reads."""

    observation_space = gymnasium.spaces.Dict(
        {"vision": gymnasium.spaces.Box(0, 1, (2,), np.float32)}
    )

    def reset(self, **others):
        return {"vision": super().reset(**others)[0]["match"]}, {}

    def step(self, action):
        seen, *rest = super().step(action)
        return {"vision": seen["match"]}, *rest


@FORMS
@pytest.mark.parametrize(
    ("env", "message"),
    [
        (lambda: wrap(Other()), r"lacks 'match': .*senses=agent.senses.*'vision'"),
        (lambda: GymWrapper(Bell()), r"lacks '(is_init|last_reward)': .*wrap or transf"),
        (
            lambda: TransformedEnv(GymWrapper(Bell()), InitTracker()),
            r"lacks 'last_reward': .*wrap or transformed of dntorch.rl",
        ),
        (
            lambda: TransformedEnv(GymWrapper(Bell()), LastReward()),
            r"lacks 'is_init': .*wrap or transformed of dntorch.rl",
        ),
    ],
    ids=["key", "nothing", "no LastReward", "no InitTracker"],
)
def test_an_env_that_lacks_what_the_agent_reads_is_named(env, message, carried) -> None:
    policy = AgentPolicy(DNSarsa(2), carried=carried)
    made = env()
    if carried:
        made = TransformedEnv(made, policy.primer())
    with pytest.raises(KeyError, match=message):
        next(iter(collector(made, policy, 4, auto_register_policy_transforms=False)))


def test_a_renamed_observation_is_read() -> None:
    env = wrap(Other()).append_transform(RenameTransform(["vision"], ["match"]))
    assert env.rollout(3, AgentPolicy(DNSarsa(2))).shape == (3,)


# ------------------------------------------------------------------ another agent


def taught(n: int = 2) -> DNSarsa:
    """An agent that has learned and is in the middle of things."""
    agent, generator = DNSarsa(n), torch.Generator().manual_seed(1)
    with torch.no_grad():
        agent.weights.uniform_(0, 1, generator=generator)
    for _ in range(20):
        agent({"match": torch.rand(n, generator=generator)}, torch.tensor(1.0), torch.zeros(n))
    return agent


def shown(n: int = 2, first: bool = False) -> TensorDict:
    seen = {"match": torch.linspace(0, 1, n), "last_reward": torch.ones(1)}
    return TensorDict(seen | {"is_init": torch.tensor([first])})


REPLACED = {
    "agent": lambda policy, other: setattr(policy, "agent", other),
    "learner": lambda policy, other: setattr(policy.agent, "learner", other.learner),
    "trace": lambda policy, other: setattr(policy.agent.learner, "trace", other.learner.trace),
    "intention": lambda policy, other: setattr(
        policy.agent.behaviors, "intention", other.behaviors.intention
    ),
    "value_nodes": lambda policy, other: setattr(policy.agent, "value_nodes", other.value_nodes),
    "all": lambda policy, other: [
        setattr(policy.agent, name, part) for name, part in list(other.named_children())
    ],
}


@pytest.mark.parametrize("which", REPLACED)
@pytest.mark.parametrize(
    "copied",
    [lambda p: p, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p))],
    ids=["itself", "deepcopy", "pickle"],
)
def test_the_agent_that_was_put_in_place_acts_and_learns(which: str, copied) -> None:
    policy = copied(AgentPolicy(DNSarsa(2)))
    for k in range(5):
        policy(shown(first=k == 0))
    REPLACED[which](policy, taught())
    alone = AgentPolicy(copy.deepcopy(policy.agent))
    for _ in range(5):
        ours, theirs = policy(shown()), alone(shown())
        assert torch.equal(ours["action"], theirs["action"])
    ours, theirs = policy.agent.snapshot(), alone.agent.snapshot()
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    assert policy.steps == 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: setattr(p, "agent", DNSarsa(3)), r"intention of the agent is \[3\], .* \[2\]"),
        (lambda p: setattr(p, "agent", DNSarsa(2, FindColor("GB"))), r"senses of the agent is"),
        (lambda p: setattr(p, "agent", DNSarsa(2).spread(4)), r"is \[4.*build another AgentPo"),
        (lambda p: p.agent.spread(4), r"is \[4.*build another AgentPolicy"),
        (lambda p: setattr(p.agent, "sensorimotor", FindColor("GB")), r"senses of the agent is"),
    ],
)
def test_an_agent_that_does_not_fit_the_policy_is_refused(change, message) -> None:
    policy = AgentPolicy(DNSarsa(2))
    policy(shown())
    with pytest.raises(ValueError, match=message):
        change(policy)
        policy(shown())


@pytest.mark.parametrize("which", REPLACED)
def test_an_agent_whose_state_is_carried_is_not_replaced(which: str) -> None:
    policy = AgentPolicy(DNSarsa(2), carried=True)
    env = wrap(Bell(), policy.primer())
    env.rollout(2, policy)
    with pytest.raises(RuntimeError, match="replaced, but what it learned lies in the tensordict"):
        REPLACED[which](policy, taught())
        env.rollout(2, policy)


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


@FORMS
@pytest.mark.parametrize("cut", [*CUTS, "reset_at_each_iter"])
@unwrapped
def test_a_collector_resumes_to_the_same_numbers_whoever_cuts_episodes(
    cut: str, carried: bool
) -> None:
    config = Config(world="nodes", steps=900, explore=600, seed=4, sequence="GB", colors="GB")

    def build_cut():
        env, policy = build(config, carried)
        if cut == "reset_at_each_iter":
            return collector(env, policy, 150, reset_at_each_iter=True)
        return cut_collector(cut, env, policy, 110, 150)

    whole = advance(build_cut(), 5)
    first, second = build_cut(), build_cut()
    advance(first, 3)
    advance(second, 1)  # it may have lived before
    second.load_state_dict(pickle.loads(pickle.dumps(first.state_dict())))
    rest = advance(second, 2)
    names = [*first.env.full_observation_spec.keys(True, True), "action", "weights", "steps"]
    for name in [*names, ("next", "found"), ("next", "reward"), ("next", "done")]:
        assert torch.equal(rest[name], whole[name][450:]), name
    assert whole["is_init"].sum() > 4 and whole["match"].any()


def test_a_reset_loses_nothing_that_is_carried_before_and_after_a_resume() -> None:
    def made():
        return collector(wrap(Bell(ends=False), policy.primer()), policy, 10)

    policy = AgentPolicy(DNSarsa(2), carried=True)
    with torch.no_grad():
        policy.agent.weights.fill_(0.5)
    first, second = made(), made()
    advance(first, 2)
    second.load_state_dict(first.state_dict())
    for each in (first, second):
        each.reset()
        batch = advance(each, 1)
        assert batch["weights"][0].min() > 0.4 and batch["steps"][0] == 21
        assert batch["last_reward"][0] == 20 and batch["is_init"][0]


def test_the_world_of_an_env_without_collector_is_saved_alone() -> None:
    env, other = build(Config(world="nodes"))[0], build(Config(world="nodes"))[0]
    other.load_state_dict(env.state_dict())  # nothing has begun yet
    shown = env.rollout(20)[-1]["next"]
    other.reset()
    other.load_state_dict(env.state_dict())
    action = torch.tensor([1.0, 0.0, 0.0, 0.0])
    one, two = (each.step(shown.clone().set("action", action)) for each in (env, other))
    assert torch.equal(one["next", "match"], two["next", "match"])
    assert torch.equal(env.base_env.state.sought, other.base_env.state.sought)


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

"""The agent in the abstract world: what it does, what it learns, what breaks without a part."""

from typing import NamedTuple

import pytest
import torch
from torch import Tensor

from dntorch.cells.opposition import OppositionState
from dntorch.cells.transient import TransientState
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.envs.nodes import NodesWorld
from dntorch.envs.task import NOTHING, SequenceTask
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.noise import Exploration

LETTERS = "RGBYOCVM"
SECOND = 32


class Record(NamedTuple):
    """What happened, step by step: ``(steps, *batch, ...)``."""

    intention: Tensor
    satisfaction: Tensor
    decisions: Tensor
    found: Tensor
    completed: Tensor
    weights: Tensor

    def sequence(self, *index):
        """Behaviours that one agent completed, in their order."""
        on = self.satisfaction[(slice(None), *index)]
        return (on[1:] & ~on[:-1]).nonzero()[:, 1].tolist()


def live(agent, world, steps, explore=True, agents=0):
    """Let an agent live in a world; noise for as long as, and for those who, explore."""
    dtype = agent.origin.dtype
    noise = Exploration(agent.n, seed=0, agents=agents)
    mask = torch.as_tensor(explore, dtype=dtype).unsqueeze(-1)
    intention = torch.zeros(*agent.decisions.shape, agent.n, dtype=dtype)
    state, record = world.initial(agents=torch.as_tensor(agents)), []
    with torch.no_grad():
        for _ in range(steps):
            seen, state = world.step(intention, state)
            added = mask * noise(agent.decisions, dtype)
            intention = agent(seen.observation, seen.reward.to(dtype), added)
            record.append((
                intention > 0.5, agent.behaviors.satisfaction.u > 0, agent.decisions.clone(),
                seen.found, seen.completed, agent.weights.clone(),
            ))  # fmt: skip
    return Record(*(torch.stack(part) for part in zip(*record, strict=True)))


def longest_run(true):
    """Most steps in a row for which it is true, over all agents."""
    run, longest = torch.zeros_like(true[0], dtype=torch.int64), 0
    for row in true:
        run = (run + 1) * row
        longest = max(longest, int(run.max()))
    return longest


def assert_orderly(record):
    """One behaviour after another, and always one that was completed last."""
    assert longest_run(record.intention.sum(-1) > 1) <= 2
    completed = record.satisfaction.sum(-1)
    assert longest_run(completed > 1) <= 2
    assert (completed[record.decisions > 0] > 0).all()
    onsets = record.satisfaction[1:] & ~record.satisfaction[:-1]
    assert torch.equal(onsets.sum((0, -1)), record.decisions[-1])


# Exploration

AGENTS, STEPS = 64, 2600


@pytest.fixture(scope="module")
def exploration():
    agents = torch.arange(AGENTS)
    return live(DNSarsa(4).spread(AGENTS), NodesWorld(), STEPS, agents=agents)


@pytest.fixture(scope="module")
def sequences(exploration):
    return [exploration.sequence(k) for k in range(AGENTS)]


def test_behaviors_follow_one_another_in_good_order(exploration):
    assert_orderly(exploration)


def test_about_300_behaviors_in_50000_steps(exploration):
    count = exploration.decisions[-1] * 50_000 / STEPS
    assert 200 < count.min() and count.max() < 400
    assert 300 < count.float().mean() < 330


def test_no_behavior_follows_itself(sequences):
    for sequence in sequences:
        assert all(a != b for a, b in zip(sequence, sequence[1:], strict=False))


def test_every_transition_is_explored_alike_returns_too(sequences):
    count, returned, triples = torch.zeros(4, 4), 0, 0
    for sequence in sequences:
        for a, b in zip(sequence, sequence[1:], strict=False):
            count[a, b] += 1
        returned += sum(a == c for a, c in zip(sequence, sequence[2:], strict=False))
        triples += len(sequence) - 2
    share = count / count.sum(1, keepdim=True)
    print(f"P(return) = {returned / triples:.3f}, transitions\n{share}")
    assert abs(returned / triples - 1 / 3) < 0.05  # three standard errors
    assert share[~torch.eye(4, dtype=torch.bool)].min() > 0.25


def test_what_the_agent_reports_is_what_the_world_judged_as_found(exploration, sequences):
    missed = 0
    for k, sequence in enumerate(sequences):
        found = exploration.found[:, k]
        judged = found[found != NOTHING].tolist()
        if judged[0] != sequence[0]:
            # No other state delays the first CoS: the agent may move on before the dwell is over.
            missed += 1
            sequence = sequence[1:]
        assert abs(len(judged) - len(sequence)) <= 1  # one may be under way at the end
        assert all(a == b for a, b in zip(judged, sequence, strict=False))
    assert missed <= 0.1 * AGENTS


def test_values_are_zero_until_the_first_reward(exploration):
    rewarded = exploration.completed.cumsum(0) > 0
    assert not exploration.weights[~rewarded].any()
    assert (exploration.weights[-1][rewarded[-1]] != 0).any((-2, -1)).all()


def test_an_agent_decides_the_same_alone_and_in_batches_in_single_and_double_precision(
    exploration,
):
    steps, chosen = 2000, [3, 17, 40]
    double = live(DNSarsa(4).double().spread(3), NodesWorld(), steps, agents=chosen)
    alone = live(DNSarsa(4), NodesWorld(), steps, agents=17)
    for k, agent in enumerate(chosen):
        expected = Record(*(part[:steps] for part in exploration)).sequence(agent)
        assert double.sequence(k) == expected and len(expected) > 8
    assert alone.sequence() == double.sequence(1)
    assert alone.weights.dtype == torch.float32 and double.weights.dtype == torch.float64


@pytest.mark.parametrize(("substeps", "integrator"), [(2, "euler"), (1, "heun")])
def test_other_integrators_take_about_as_many_behaviors(exploration, substeps, integrator):
    steps = 640
    agent = DNSarsa(4, substeps=substeps, integrator=integrator).spread(AGENTS)
    record = live(agent, NodesWorld(), steps, agents=torch.arange(AGENTS))
    assert_orderly(record)
    expected = exploration.decisions[steps - 1].float().mean()
    assert record.decisions[-1].float().mean() == pytest.approx(float(expected), rel=0.05)


def test_the_first_behavior_is_a_matter_of_chance(sequences):
    first = torch.bincount(torch.tensor([sequence[0] for sequence in sequences]), minlength=4)
    assert first.min() > 6  # of 16 each


@pytest.mark.parametrize("n", [2, 20, 24, 28, 32, 64])
def test_any_number_of_behaviors_starts_from_rest(n):
    """With noise and without, one intention comes on and is alone."""
    agent, seen = DNSarsa(n).spread(2), {"match": torch.zeros(2, n)}
    noise = Exploration(n, 0, [0, 1])(agent.decisions) * torch.tensor([[1.0], [0.0]])
    with torch.no_grad():
        for _ in range(2 * SECOND):
            intention = agent(seen, torch.zeros(2), noise)
    assert ((intention > 0.5).sum(-1) == 1).all()
    assert intention.argmax(-1).tolist() == [int(noise[0].argmax()), n - 1]


@pytest.mark.parametrize("n", [2, 3, 6, 8])
def test_any_number_of_behaviors_keeps_going_with_and_without_noise(n):
    agents, explore = torch.arange(64), torch.arange(64) > 0
    world = NodesWorld(SequenceTask("RG", LETTERS[:n]), longest=2.0)
    record = live(DNSarsa(n).spread(64), world, 720, explore, agents=agents)
    assert_orderly(record)
    assert record.decisions[-1].min() >= 5
    assert (record.decisions[-1] > record.decisions[-240]).all()


# Learning


def test_reward_raises_what_came_before_it_the_latest_pair_the_most():
    agents = torch.arange(48)
    world = NodesWorld(SequenceTask("GB", "RGB"), longest=2.0)
    record = live(DNSarsa(3).spread(48), world, 24 * SECOND, agents=agents)
    first = record.completed.int().argmax(0)
    # The very first pair is remembered best, for there was no other: wait until it has faded.
    rewarded = record.completed.any(0) & (record.decisions.gather(0, first[None])[0] >= 4)
    checked = 0
    for k in agents[rewarded].tolist():
        later = int(first[k]) + 2 * SECOND  # the reward is over, nothing else was completed
        if later >= len(record.weights) or record.completed[first[k] + 1 : later, k].any():
            continue
        weights = record.weights[later, k]
        assert weights.argmax() == 2 * 3 + 1  # action B in state G
        assert weights.min() >= 0 and weights.max() > 0.01
        checked += 1
    assert checked >= 8


def test_an_episode_explores_anew():
    """`reset` does not restart the random order: decisions count over the agent's life."""
    agent, orders = DNSarsa(4), []
    for _ in range(3):
        agent.reset()
        orders.append(tuple(live(agent, NodesWorld(longest=2.0), 24 * SECOND).sequence()[:5]))
    assert all(len(order) == 5 for order in orders) and len(set(orders)) == 3


def test_without_learning_values_stay_as_they_are():
    agents = torch.arange(16)
    agent = DNSarsa(3).spread(16)
    agent.weights.uniform_(0, 1, generator=torch.Generator().manual_seed(0))
    start = agent.weights.clone()
    agent.learn(False)
    world = NodesWorld(SequenceTask("GB", "RGB"), longest=2.0)
    record = live(agent, world, 16 * SECOND, agents=agents)
    assert record.completed.any()
    assert torch.equal(agent.weights, start)
    agent.learn()
    assert not torch.equal(live(agent, world, SECOND, agents=agents).weights[-1], start)


def test_found_sequences_are_executed_after_exploration():
    agents = torch.arange(64)
    world = NodesWorld(SequenceTask("RGR", "RGBY"), longest=1.5)
    agent = DNSarsa(4).spread(64)
    found = live(agent, world, 60 * SECOND, agents=agents).completed.any(0)
    assert found.sum() >= 16
    agent.reset()
    record = live(agent, world, 36 * SECOND, explore=False, agents=agents)
    late = record.completed[16 * SECOND :].sum(0)[found]
    print(f"{found.sum()} found, rewards afterwards {late.tolist()}")
    assert (late >= 2).float().mean() > 0.8


def test_values_of_the_optimal_policy_make_the_agent_repeat_the_sequence():
    agent, order = DNSarsa(4), ["RGBY".index(letter) for letter in "GBYRG"]
    for state, action in zip(order, order[1:], strict=False):
        agent.weights[action, state] = 1.0
    record = live(agent, NodesWorld(longest=2.0), 60 * SECOND, explore=False)
    letters = "".join("RGBY"[k] for k in record.sequence())
    assert len(letters) >= 16
    assert letters in "RGBY" * 20 or letters[1:] in "RGBY" * 20
    assert record.completed.sum() == sum(letters.startswith("GBYRG", k) for k in range(60)) >= 3


# One step


def parts(state):
    """The activation of an agent by name."""
    return {
        "intention": state.behaviors.intention.u,
        "satisfaction": state.behaviors.satisfaction.u,
        "values": state.value_nodes.value,
        "pulse": state.learner.pulses.pulse,
        "inhibitory": state.learner.pulses.inhibitory,
        "trace": state.learner.trace.u,
        "opposition": state.learner.opposition.opposition,
        "error": state.learner.opposition.error,
        "weights": state.learner.values.weights,
    }


READERS = {
    "observation": {"satisfaction"},
    "reward": {"weights"},
    "noise": {"values"},
    "intention": {"intention", "satisfaction", "pulse", "inhibitory", "weights"},
    "satisfaction": {"intention", "satisfaction", "values", "pulse", "inhibitory", "weights"},
    "values": {"intention", "values"},
    "pulse": {"pulse", "trace", "opposition"},
    "inhibitory": {"pulse", "inhibitory"},
    "trace": {"trace", "opposition", "weights"},
    "opposition": {"opposition", "error"},
    "error": {"error", "weights"},
    "weights": {"values", "opposition", "weights"},
}


@pytest.mark.parametrize(("changed", "readers"), READERS.items())
def test_in_one_step_a_change_reaches_those_only_who_read_it(changed, readers):
    """All parts read what was at the beginning of the step: no result depends on an order."""
    agent, half = DNSarsa(3), torch.tensor([0.2, 0.5, 0.3])
    state = agent.initial([])
    for value in parts(state).values():
        value.fill_(0.5)
    parts(state)["intention"].copy_(torch.tensor([2.0, -2.0, -2.0]))
    parts(state)["satisfaction"].copy_(torch.tensor([-2.0, 2.0, -2.0]))
    inputs = {
        "observation": {"match": half},
        "reward": torch.tensor(0.3),
        "noise": torch.arange(1.0, 4.0) / 9,
    }
    before = {k: v.clone() for k, v in parts(agent.step(*inputs.values(), state)[1]).items()}
    leaf = half if changed == "observation" else {**inputs, **parts(state)}[changed]
    leaf.mul_(-1.1)
    after = parts(agent.step(*inputs.values(), state)[1])
    assert {name for name in after if not torch.equal(before[name], after[name])} == readers


# Members of a batch


def trained(batch):
    agent = DNSarsa(3).spread(batch)
    agent.weights.uniform_(0, 1, generator=torch.Generator().manual_seed(1))
    return agent


def test_one_agent_is_taken_out_of_a_batch():
    agent = trained(5)
    live(agent, NodesWorld(SequenceTask("GB", "RGB")), SECOND, agents=torch.arange(5))
    one = agent.select(3)
    assert torch.equal(one.weights, agent.weights[3])
    assert one.decisions.shape == () and one.behaviors.intention.u.eq(-5).all()
    one.forget()
    assert agent.weights[3].all()
    assert agent.decisions.shape == (5,)


def test_values_travel_through_a_checkpoint_into_another_agent():
    one = trained(5).select(3)
    robot = DNSarsa(3, substeps=2)
    robot.load_state_dict(one.state_dict())
    assert torch.equal(robot.weights, one.weights)


def test_values_of_one_are_spread_over_a_batch_that_learns_apart():
    agent = trained(5).select(3)
    start = agent.weights.clone()
    many = agent.spread(4)
    assert torch.equal(many.weights, start.expand(4, 3, 3))
    world = NodesWorld(SequenceTask("GB", "RGB"), longest=2.0)
    live(many, world, 8 * SECOND, agents=torch.arange(4))
    assert many.weights.unique(dim=0).shape[0] == 4


# What breaks without a part


def two_state_loop(cycles, start=0.0, batch=()):
    """Pairs (1, 0) and (0, 1) in turn, for ever; reward of the area of a pulse after the first.

    In discrete SARSA: Q1 = R + gamma Q2 and Q2 = gamma Q1. Returns both after each cycle,
    ``(cycles, *batch, 2)``.
    """
    learner = Learner(2, values=HebbianQ(2, learning_rate=0.6).spread(*batch)).resize(*batch)
    learner.double().values.weights.add_(torch.as_tensor(start).unsqueeze(-1).unsqueeze(-1))
    on, values = torch.eye(2, dtype=torch.float64).expand(*batch, 2, 2), []
    for _ in range(cycles):
        for action in (1, 0):
            for step in range(3 * SECOND):
                reward = 2.22 if action == 0 and step < SECOND else 0.0
                reward = torch.full(batch, reward, dtype=torch.float64)
                learner(on[..., action, :], on[..., 1 - action, :], reward)
        weights = learner.values.weights
        values.append(torch.stack((weights[..., 1, 0], weights[..., 0, 1]), -1).clone())
    return torch.stack(values)


def test_values_of_a_loop_go_to_the_fixed_point_of_discrete_sarsa():
    """From below and from above."""
    values = two_state_loop(20, start=[2.0, 3.5], batch=(2,))
    for last in values[-1]:
        assert last[0] == pytest.approx(1 / (1 - 0.8**2), rel=0.05)
        assert last[1] / last[0] == pytest.approx(0.8, rel=0.02)
    assert (values[:, 0].diff(dim=0)[4:] > 0).all() and (values[:, 1].diff(dim=0)[4:] < 0).all()


def only(part):
    """A value opposition that sees only one kind of pulse."""
    euler = ValueOpposition.euler
    return lambda self, pulse, *rest: euler(self, part(pulse), *rest)


def test_without_the_offset_pulse_values_do_not_converge(monkeypatch):
    monkeypatch.setattr(ValueOpposition, "euler", only(lambda pulse: pulse.clamp_min(0)))
    values = two_state_loop(10)
    assert values[-1, 0] > 2 / (1 - 0.8**2)
    assert (values.diff(dim=0) > 0).all()
    assert (values[2:].diff(dim=0).diff(dim=0) > 0).all()  # faster and faster


def test_without_the_onset_pulse_nothing_is_predicted(monkeypatch):
    monkeypatch.setattr(ValueOpposition, "euler", only(lambda pulse: pulse.clamp_max(0)))
    first, second = two_state_loop(12)[-1]
    assert first == pytest.approx(1, rel=0.1) and abs(second) < 0.1


def test_without_pulses_nothing_is_learned(monkeypatch):
    def silent(self, input, state):
        rest = torch.zeros_like(state.pulse)
        return TransientState(rest, rest)

    monkeypatch.setattr(TPCell, "euler", silent)
    assert not two_state_loop(3).any()


def test_without_the_trace_nothing_is_learned(monkeypatch):
    def silent(self, input, state):
        return WorkingMemoryState(0 * state.u)

    monkeypatch.setattr(ItemOrderWM, "euler", silent)
    assert not two_state_loop(3).any()


def test_without_the_value_cell_nothing_is_predicted_or_bounded(monkeypatch):
    def silent(self, pulse, trace, weights, state):
        return OppositionState(0 * state.opposition, 0 * state.error)

    monkeypatch.setattr(ValueOpposition, "euler", silent)
    first, second = two_state_loop(8).unbind(-1)
    assert not second.any()
    assert first[-1] > 1 / (1 - 0.8**2)
    assert first.diff()[-1] == pytest.approx(float(first.diff()[2]), rel=0.05)  # for ever


# The world


def test_a_sought_color_comes_into_view_is_found_once_and_lingers():
    world = NodesWorld(shortest=1.0, longest=1.0, dwell=0.5, linger=0.5)
    state, green = world.initial(), torch.tensor([0.0, 1.0, 0.0, 0.0])
    seen, found = [], []
    for k in range(4 * SECOND):
        step, state = world.step(green if k < 2 * SECOND else 0 * green, state)
        seen.append(bool(step.observation["match"][1]))
        found.append(int(step.found))
    assert seen.index(True) == SECOND and sum(seen) == SECOND + SECOND // 2
    assert found.index(1) == SECOND + SECOND // 2 - 1 and found.count(NOTHING) == len(found) - 1


def test_durations_fill_their_range_and_belong_to_agent_and_visit():
    world = NodesWorld(shortest=1.5, longest=6.0)
    state = world.initial(seed=4, agents=torch.arange(1000))
    seconds = state.ahead / SECOND
    assert seconds.min() >= 1.5 and seconds.max() <= 6.0
    assert seconds[:, 1].mean() == pytest.approx(3.75, abs=0.15)
    assert torch.equal(state.ahead[7], world.initial(seed=4, agents=7).ahead)
    assert not torch.equal(seconds[:, 1], seconds[:, 2])
    later = world.provide(state._replace(visits=state.visits + 5))
    assert torch.equal(later.ahead[:, :9], state.ahead[:, 5:14])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"linger": 0.25}, r"linger=0.25 is shorter than dwell="),
        ({"shortest": 0.0}, r"shortest=0.0, longest=6.0: give 0 < shortest <= longest"),
        ({"shortest": 7.0}, r"shortest=7.0, longest=6.0: give 0 < shortest <= longest"),
    ],
)
def test_wrong_arguments_name_argument_value_and_remedy(options, message):
    with pytest.raises(ValueError, match=message):
        NodesWorld(**options)

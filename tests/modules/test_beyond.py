"""What the agent may have beyond the paper: each part alone, and in the agent."""

import copy
import itertools
import math
import pickle

import pytest
import torch

from dntorch import (
    Constraints,
    Curiosity,
    Dissatisfaction,
    DNSarsa,
    ElementaryBehaviors,
    Exploration,
    Habituation,
    Learner,
    Recall,
    TPCell,
    ValueNodes,
)
from dntorch.cells.functions import is_on
from dntorch.envs.nodes import NodesWorld
from dntorch.envs.task import NOTHING, SequenceTask

N = 4


def one(k, n=N):
    return torch.eye(n)[k]


def live(agent, world, steps, noise=None, agents=None):
    """What a batch of agents found: lists of colours; and the agent's intentions, step by step."""
    numbers = torch.arange(agent.origin.numel()) if agents is None else agents
    exploration = noise or Exploration(agent.n, 0, numbers)
    state = world.initial(tuple(agent.origin.shape), 0, numbers)
    observation, reward = world.observe(state), torch.zeros(agent.origin.shape)
    found, wanted = [[] for _ in numbers], []
    with torch.no_grad():
        for _ in range(steps):
            action = agent(observation, reward, exploration(agent.decisions))
            outcome, state = world.step(action, state)
            observation, reward = outcome.observation, outcome.reward
            wanted.append(action)
            for k, color in enumerate(outcome.found.tolist()):
                if color != NOTHING:
                    found[k].append(color)
    return found, torch.stack(wanted)


def waiting(n=N, patience=2.0):
    return ElementaryBehaviors(n, dissatisfaction=Dissatisfaction(n, patience=patience))


# ------------------------------------------------------------------ recall


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_recall_keeps_the_completions_before_the_last_in_their_order(depth):
    """As CoS nodes change over in the agent, behaviours of 1.5 s and longer."""
    agent = DNSarsa(N, recall=Recall(N, depth)).spread(6)
    numbers, world = torch.arange(6), NodesWorld()
    noise, state = Exploration(N, 0, numbers), world.initial((6,), 0, numbers)
    observation, reward, done = world.observe(state), torch.zeros(6), [[] for _ in numbers]
    checked, before = 0, torch.zeros(6, N, dtype=torch.bool)
    with torch.no_grad():
        for _ in range(2500):
            action = agent(observation, reward, noise(agent.decisions))
            outcome, state = world.step(action, state)
            observation = outcome.observation
            part = agent.deliberation.recall
            rates, recalled = agent.behaviors.output(agent.behaviors.state), part.output(part.state)
            # An intention is on again: the decision was taken, with this context.
            decided = is_on(rates[0]).any(-1) & ~before.any(-1)
            before = is_on(rates[0])
            for k, color in enumerate(agent_onsets(rates[1], done)):
                if color is not None:
                    done[k].append(color)
            for k in decided.nonzero()[:, 0].tolist():
                if len(done[k]) > depth:
                    assert is_on(recalled[k]).sum(-1).tolist() == [1] * depth
                    assert recalled[k].argmax(-1).tolist() == done[k][-2 : -2 - depth : -1]
                    checked += 1
    assert checked > 60


def agent_onsets(satisfaction, done):
    """Colour whose CoS node is on and was not the last to be noted, for each agent."""
    for rates, noted in zip(satisfaction, done, strict=True):
        on = is_on(rates).nonzero()[:, 0].tolist()
        new = [color for color in on if not noted or color != noted[-1]]
        yield new[0] if len(on) == 1 and new else None


def test_a_context_counts_the_last_completion_first():
    recall = Recall(3, 2)
    for last, before, earlier in itertools.product(range(3), repeat=3):
        recalled = torch.stack((one(before, 3), one(earlier, 3)))
        context = recall.context(one(last, 3), recalled)
        assert context.argmax() == 9 * last + 3 * before + earlier and context.sum() == 1
    assert not recall.context(one(0, 3), torch.zeros(2, 3)).any()  # too few were completed


# ------------------------------------------------------------------ habituation


def test_a_spent_behaviour_recovers_exponentially():
    habituation = Habituation(N, order=1, recovery=100.0, sharpness=1.0)
    for _ in range(320):
        spent = habituation(one(1), one(0))
    start = float(1 - spent[1])
    for _ in range(32 * 50):
        fresh = habituation(torch.zeros(N), one(0))
    assert 1 - float(fresh[1]) == pytest.approx(start * math.exp(-0.5), rel=1e-3)
    assert fresh[[0, 2, 3]].tolist() == [1.0, 1.0, 1.0]


def tried_again(found, order):
    """Choices that repeat one of the same context, where another was left, among all of those."""
    again = total = 0
    for sequence in found:
        seen = {}
        for k in range(order, len(sequence)):
            tried = seen.setdefault(tuple(sequence[k - order : k]), set())
            if 0 < len(tried) < N - 1:
                again, total = again + (sequence[k] in tried), total + 1
            tried.add(sequence[k])
    return again / total


@pytest.mark.parametrize("order", [1, 2])
def test_habituation_tries_what_is_fresh_in_its_context(order):
    task = SequenceTask(reward=0.0)
    shares = []
    for part in (None, Habituation(N, order)):
        agent = DNSarsa(N, habituation=part).spread(12)
        shares.append(tried_again(live(agent, NodesWorld(task), 3000)[0], order))
    assert shares[0] > 0.3 and shares[1] < 0.05


def test_without_context_all_is_fresh_and_reset_makes_it_so():
    habituation = Habituation(N, order=3)
    for _ in range(64):
        fresh = habituation(one(1), one(0))
    assert fresh.tolist() == [1.0] * N  # one was completed, a context takes three
    single = Habituation(N, order=0)
    for _ in range(64):
        single(one(1), torch.zeros(N))
    assert single.spent[0, 1] > 0.9
    single.reset()
    assert not single.spent.any()


# ------------------------------------------------------------------ dissatisfaction


def test_an_intention_in_vain_ends_and_the_decision_is_drawn_anew():
    world = NodesWorld(feasible=torch.zeros(N, N, dtype=torch.bool))
    for behaviors, failures in ((None, 0), (waiting(), 10)):
        agent = DNSarsa(N, behaviors=behaviors).spread(5)
        _, wanted = live(agent, world, 1200)
        assert (agent.failures >= failures).all() and torch.equal(agent.failures, agent.decisions)
        tried = is_on(wanted).any(0).sum(-1)
        assert (tried == 1).all() if behaviors is None else (tried >= 3).all()
        assert is_on(wanted).sum(-1).max() == 1


def test_a_failure_leaves_the_last_completion():
    """The state in which the next decision is taken is still the same."""
    feasible = torch.zeros(N, N, dtype=torch.bool)
    feasible[1] = True  # behaviour 1 alone is possible, once: it may not follow itself
    agent = DNSarsa(N, behaviors=waiting()).spread(4)
    live(agent, NodesWorld(feasible=feasible), 2500)
    assert (agent.failures > 5).all()
    _, satisfaction = agent.behaviors.output(agent.behaviors.state)
    assert is_on(satisfaction).tolist() == [[False, True, False, False]] * 4


def test_nothing_changes_where_nothing_fails():
    agents = [DNSarsa(N).spread(4), DNSarsa(N, behaviors=waiting(patience=20.0)).spread(4)]
    for agent in agents:
        live(agent, NodesWorld(), 2000)
    plain, patient = (agent.flat(agent.state) for agent in agents)
    assert plain["decisions"].min() > 8 and not patient["failures"].any()
    for name, value in plain.items():
        assert torch.equal(value, patient[name]), name


# ------------------------------------------------------------------ constraints


def test_failures_teach_and_a_success_unlearns():
    constraints, none = Constraints(N), torch.zeros(N)
    for _ in range(12):
        constraints(one(2), one(0), none, torch.zeros(N, N))
    allowed = constraints.allowed(one(0), constraints.state)
    assert allowed[2] < 0.01 and (allowed[[0, 1, 3]] == 1).all()
    assert (constraints.allowed(one(1), constraints.state) == 1).all()
    offset = torch.zeros(N, N)
    offset[2, 0] = -0.3
    for _ in range(32):
        constraints(none, none, one(2), offset)
    assert constraints.allowed(one(0), constraints.state)[2] > 0.9


def test_constraints_act_on_shares_so_that_the_rest_decides_as_surely():
    """Of sixteen behaviours fourteen are suppressed: one of the two others comes on, alone."""
    n = 16
    constraints = Constraints(n)
    constraints.suppression[:14] = 1.0
    allowed = constraints.allowed(one(15, n), constraints.state) * (1 - one(15, n))
    nodes, noise = ValueNodes(n), torch.linspace(0.05, 0.1, n)
    for _ in range(64):
        value = nodes(one(15, n), torch.zeros(n, n), noise.flip(0), allowed)
    assert value.argmax() == 14 and value[14] > 0.99 and value[:14].max() < 1e-6
    constraints.suppression.fill_(1.0)  # where all fail, one is tried still
    allowed = constraints.allowed(one(15, n), constraints.state) * (1 - one(15, n))
    for _ in range(64):
        value = nodes(one(15, n), torch.zeros(n, n), noise, allowed)
    assert value.max() > 0.99


def test_an_agent_learns_what_does_not_follow():
    feasible = torch.zeros(N, N, dtype=torch.bool)
    for k in range(N):
        feasible[k, k - 1] = True  # a round: each is possible after one other
    failures = []
    for part in (None, Constraints(N)):
        agent = DNSarsa(N, behaviors=waiting(patience=8.0), constraints=part).spread(6)
        live(agent, NodesWorld(SequenceTask(reward=0.0), feasible=feasible), 6000)
        failures.append(agent.failures.float().mean())
    known = agent.deliberation.constraints.suppression
    assert (known * feasible).max() < 0.1  # nothing that is possible is taken for impossible
    assert failures[1] <= 8 and failures[0] > 12  # eight are impossible


# ------------------------------------------------------------------ curiosity


def test_what_brightens_the_lamp_is_valued_and_what_dims_it_is_not():
    curiosity, none = Curiosity(N, 3), torch.zeros(N)
    for action, before, after in ((1, 0.0, 0.5), (2, 0.5, 0.0), (3, 0.0, 0.0)):
        for k in range(160):
            curiosity(one(action) if k < 64 else none, torch.tensor([before if k < 64 else after]))
    value = curiosity.value(torch.tensor([0.0]), curiosity.state)
    assert value[1] > 0.2 and value[3].abs() < 1e-3
    assert curiosity.value(torch.tensor([0.5]), curiosity.state)[2] < -0.2
    assert curiosity.value(torch.tensor([1.0]), curiosity.state).tolist() == [0.0] * N


def test_an_agent_with_a_lamp_finds_long_sequences():
    task = SequenceTask("ROYGR", "ROYGCB")
    world = NodesWorld(task, senses=("match", "lamp"))
    agent = DNSarsa(6, curiosity=Curiosity(6, 6)).spread(8)
    noise = Exploration(6, 0, range(8), amplitude=0.05)
    found, _ = live(agent, world, 16_000, noise)
    target = [0, 1, 2, 3, 0]
    first = [next((k for k in range(5, len(f)) if f[k - 5 : k] == target), None) for f in found]
    assert sum(k is not None for k in first) >= 7  # of 3,750 sequences, within 100 behaviours


def test_learning_switched_off_stops_in_every_part():
    agent = DNSarsa(
        N, behaviors=waiting(), constraints=Constraints(N), curiosity=Curiosity(N, 6)
    ).spread(3)
    world = NodesWorld(senses=("match", "lamp"), feasible=torch.eye(N).roll(1, 0).bool())
    agent.learn(False)
    live(agent, world, 1500)
    learned = {k: v for k, v in agent.state_dict().items()}
    assert len(learned) == 3 and not any(v.any() for v in learned.values())
    agent.learn()
    live(agent, world, 1500)
    assert agent.deliberation.constraints.suppression.any()
    assert agent.deliberation.curiosity.weights.any()


# ------------------------------------------------------------------ what does not fit


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Habituation(64), "order=4: n=64 .* 1,073,741,824 cells .* at most order=2"),
        (lambda: Habituation(N, -1), "order=-1: give at least one"),
        (lambda: Habituation(N, 3, recall=Recall(N)), r"recall.depth=1 .* give Recall\(4, 2\)"),
        (lambda: Habituation(N, recovery=0.01), "longer than recovery=0.01"),
        (lambda: Recall(100, 4), "depth=4: 10,000,000,000 states .* at most 2"),
        (lambda: Recall(N, excitation=4.0), r"excitation \+ h=-1.0 must be positive"),
        (lambda: Recall(N, pulse_gain=10.0), "must be positive: give more pulse_gain"),
        (lambda: Dissatisfaction(N, patience=0.0), "patience=0.0 must be positive"),
        (lambda: Dissatisfaction(N, gain=4.0), "give more gain"),
        (lambda: Constraints(N, learning_rate=40.0), "too large for dt=0.03125: give at most 32"),
        (lambda: Constraints(N, states=6), "states=6 is no multiple of n=4"),
        (lambda: Curiosity(N, 1), "levels=1: give at least two"),
        (lambda: Learner(N, states=2 * N + 1), "states=9 is no multiple of n=4"),
        (
            lambda: DNSarsa(N, learner=Learner(N), recall=Recall(N)),
            "learner.states=4 does not fit: build the part with states=16",
        ),
        (
            lambda: DNSarsa(N, behaviors=waiting(), constraints=Constraints(N), recall=Recall(N)),
            "constraints.states=4 does not fit: build the part with states=16",
        ),
        (
            lambda: DNSarsa(N, constraints=Constraints(N)),
            "no intention fails: give behaviors=ElementaryBehaviors",
        ),
        (lambda: DNSarsa(N, habituation=Habituation(3)), "habituation.n=3 does not fit n=4"),
        (lambda: Curiosity(N, 3, lamp=TPCell((2,))), r"lamp.shape=\(2,\) .* TPCell\(\(1,\)\)"),
        (lambda: Curiosity(N, 3, pulses=TPCell((N, 2))), r"pulses.shape=\(4, 2\) .*\(4, 3\)\)"),
    ],
)
def test_parts_that_do_not_fit_are_refused_in_one_sentence(build, words):
    with pytest.raises(ValueError, match=words) as refused:
        build()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: DNSarsa(N, recall=Habituation(N)), "recall=Habituation is no Recall: give one"),
        (lambda: DNSarsa(N, habituation=3), "habituation=3 is no Habituation: give one"),
        (lambda: ElementaryBehaviors(N, dissatisfaction=20.0), "=20.0 is no Dissatisfaction"),
    ],
)
def test_what_is_no_such_part_is_refused_in_one_sentence(build, words):
    with pytest.raises(TypeError, match=words) as refused:
        build()
    assert "\n" not in str(refused.value)


def whole(n=N, **numbers):
    """An agent with every part, with numbers per agent if there are any."""
    own = {name: {} for name in ("recall", "habituation", "dissatisfaction", "constraints",
                                 "curiosity")} | numbers  # fmt: skip
    return DNSarsa(
        n,
        behaviors=ElementaryBehaviors(
            n, dissatisfaction=Dissatisfaction(n, **{"patience": 2.0} | own["dissatisfaction"])
        ),
        recall=Recall(n, **own["recall"]),
        habituation=Habituation(n, 2, **own["habituation"]),
        constraints=Constraints(n, states=n * n, **own["constraints"]),
        curiosity=Curiosity(n, 3, **own["curiosity"]),
    )


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("habituation", None, "habituation=None can't be set"),
        ("recall", None, "recall=None can't be set"),
        ("recall", Recall(N, 2), "recall of 64 states does not fit the 16 of this agent"),
        ("constraints", Constraints(N), "constraints.states=4 does not fit"),
        ("curiosity", Curiosity(N + 1, 3), "curiosity.n=5 does not fit n=4"),
        ("habituation", Habituation(N, dt=1 / 64), "habituation.dt=0.015625 does not fit"),
    ],
)
def test_a_part_that_does_not_fit_is_not_put_in_place(name, value, words):
    agent, world = whole(), NodesWorld(senses=("match", "lamp"))
    live(agent.spread(1), world, 30)
    before, held = agent.flat(agent.state), getattr(agent.deliberation, name)
    with pytest.raises(ValueError, match=words) as refused:
        setattr(agent.deliberation, name, value)
    assert "\n" not in str(refused.value)
    assert getattr(agent.deliberation, name) is held
    for key, tensor in agent.flat(agent.state).items():
        assert torch.equal(tensor, before[key]), key


def test_a_part_is_put_in_place_while_the_agent_runs():
    agent = DNSarsa(N).spread(3)
    live(agent, NodesWorld(), 60)
    agent.deliberation.habituation = Habituation(N, order=0)
    live(agent, NodesWorld(), 60)
    spent = agent.deliberation.habituation.spent
    assert spent.shape == (3, 1, N) and (spent.amax((1, 2)) > 0.3).all()


def test_numbers_of_each_agent_are_what_agents_alone_have():
    each = torch.tensor([1.0, 2.0, 4.0])
    numbers = {
        "recall": {"tau": 0.04 * each, "pulse_gain": 30 * each, "h": -5 + 0 * each},
        "habituation": {"fatigue": each, "recovery": 100 * each, "sharpness": each},
        "dissatisfaction": {"patience": 1 + each / 4, "release": 0.1 * each, "tau": 0.3 * each},
        "constraints": {"learning_rate": 4 * each},
        "curiosity": {"learning_rate": each, "gain": each},
    }
    batch, world = whole(**numbers).spread(3), NodesWorld(senses=("match", "lamp"))
    alone = [batch.select(k) for k in range(3)]
    noise = Exploration(N, 0, range(3))
    state = world.initial((3,), 0, torch.arange(3))
    observation, reward = world.observe(state), torch.zeros(3)
    with torch.no_grad():
        for _ in range(400):
            drawn = noise(batch.decisions)
            action = batch(observation, reward, drawn)
            for k, agent in enumerate(alone):
                agent({name: value[k] for name, value in observation.items()}, reward[k], drawn[k])
            outcome, state = world.step(action, state)
            observation, reward = outcome.observation, outcome.reward
    own = batch.flat(batch.state)
    assert own["failures"].min() > 0 and own["failures"].unique().numel() > 1
    for k, agent in enumerate(alone):
        assert float(agent.deliberation.habituation.recovery) == 100 * each[k]
        for name, value in agent.flat(agent.state).items():
            torch.testing.assert_close(value, own[name][k], rtol=1e-4, atol=1e-5, msg=name)


def test_forgetting_erases_what_each_part_learned_and_a_reset_only_what_it_does():
    agent = whole(dissatisfaction={"patience": 5.0}).spread(2)
    live(agent, NodesWorld(SequenceTask("GB"), senses=("match", "lamp")), 1500)
    learned = agent.state_dict()
    assert len(learned) == 3 and all(value.any() for value in learned.values())
    agent.reset()
    assert all(torch.equal(value, agent.state_dict()[key]) for key, value in learned.items())
    assert not agent.deliberation.habituation.spent.any()
    agent.forget()
    assert not any(value.any() for value in agent.state_dict().values())


def test_a_copy_of_an_agent_amid_its_life_goes_on_alike():
    agent = whole(dissatisfaction={"patience": 9.0}).spread(2)
    world = NodesWorld(senses=("match", "lamp"))
    live(agent, world, 200)
    twins = [copy.deepcopy(agent), pickle.loads(pickle.dumps(agent))]
    found = [live(each, world, 500)[0] for each in (agent, *twins)]
    assert found[0][0] and found[1] == found[0] == found[2]
    for twin in twins:
        for name, value in agent.flat(agent.state).items():
            assert torch.equal(value, twin.flat(twin.state)[name]), name


@pytest.mark.parametrize("kinds", ["with the parts", "without"])
def test_what_another_agent_learned_is_refused_where_parts_differ(kinds):
    ours, theirs = (whole(), DNSarsa(N)) if kinds == "without" else (DNSarsa(N), whole())
    before = ours.snapshot()
    for refuses in (
        lambda: ours.load_state_dict(theirs.state_dict()),
        lambda: ours.restore(theirs.snapshot()),
        lambda: setattr(ours, "state", theirs.state),
    ):
        with pytest.raises(ValueError, match=r"another architecture| has (one|no)") as refused:
            refuses()
        assert "\n" not in str(refused.value)
    assert all(torch.equal(value, before[name]) for name, value in ours.snapshot().items())


@pytest.mark.parametrize("value", [torch.tensor([1]), torch.tensor([True]), torch.ones(1).double()])
def test_a_lamp_of_any_dtype_is_seen(value):
    agents = [DNSarsa(N, curiosity=Curiosity(N, 3)) for _ in range(2)]
    for agent, lamp in zip(agents, (value, torch.ones(1)), strict=True):
        for _ in range(3):
            agent({"match": torch.zeros(N), "lamp": lamp}, torch.tensor(0.0), torch.zeros(N))
    assert agents[0].deliberation.curiosity.lamp.pulse > 0
    for name, tensor in agents[1].flat(agents[1].state).items():
        assert torch.equal(tensor, agents[0].flat(agents[0].state)[name])


def test_a_lamp_of_another_shape_is_one_sentence():
    agent = DNSarsa(N, curiosity=Curiosity(N, 3))
    for lamp in (torch.zeros(2), torch.tensor(0.0)):
        with pytest.raises(ValueError, match=r"lamp of shape \[2?\] does not end in \[1\]"):
            agent({"match": torch.zeros(N), "lamp": lamp}, torch.tensor(0.0), torch.zeros(N))


def test_a_world_without_a_lamp_is_refused_before_the_step():
    agent = DNSarsa(N, curiosity=Curiosity(N, 3))
    held = agent.flat(agent.state)
    with pytest.raises(ValueError, match=r"lacks 'lamp', it has .*: ask the world for it"):
        agent({"match": torch.zeros(N)}, torch.tensor(0.0), torch.zeros(N))
    for name, value in agent.flat(agent.state).items():
        assert torch.equal(value, held[name])

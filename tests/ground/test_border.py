"""Numbers that are not finite are read as 0 at the agent's border, and counted."""

import math

import pytest
import torch
from structures import CASES, assert_same, awake, compiled, exported, jit, over, scripted, stream
from torch.utils._pytree import tree_map

from dntorch import DNSarsa

AGENTS = {k: v for k, v in CASES.items() if k.startswith("DNSarsa")}
BAD = [math.nan, math.inf, -math.inf]


def spoilt(inputs, which, bad, member=None):
    """The inputs, and the same with 0 where the spoilt ones have a bad number."""
    chosen = (lambda x: x) if member is None else (lambda x: x[member])
    wrong, mended = (tree_map(torch.clone, inputs) for _ in range(2))
    for each, value in ((wrong, bad), (mended, 0.0)):
        target = each[which]
        target = next(iter(target.values())) if isinstance(target, dict) else target
        chosen(target).view(-1)[0] = value
    return wrong, mended


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("which", [0, 1, 2], ids=["observation", "reward", "noise"])
@pytest.mark.parametrize("translate", [None, scripted, compiled, exported])
@jit
def test_a_bad_number_counts_as_none(which, bad, translate):
    case = AGENTS["DNSarsa"]
    agent, twin = awake(case), awake(case)
    (inputs,) = stream(case, 1)
    wrong, mended = spoilt(inputs, which, bad)
    counted = int(agent.ignored)
    stepped = translate(agent, inputs) if translate else agent
    agent.state = twin.state  # a translation may have stepped it
    output = stepped(*wrong)
    assert torch.equal(output, twin(*mended))
    held = {name.removeprefix("_orig_mod."): x for name, x in stepped.named_buffers()}
    assert held["ignored"] == counted + 1 and twin.ignored == counted
    assert torch.equal(held["learner.values.weights"], twin.weights)
    assert torch.isfinite(held["learner.values.weights"]).all()


@over(AGENTS)
def test_one_member_of_a_batch_does_not_spoil_another(case):
    agent, twin = awake(case, 3), awake(case, 3)
    (inputs,) = stream(case, 1, 3)
    for which in (1, 2):
        wrong, mended = spoilt(inputs, which, math.nan, member=1)
        before = agent.ignored.clone()
        agent(*wrong), twin(*mended)
        assert (agent.ignored - before).tolist() == [0, 1, 0]
    assert_same(agent.state._replace(ignored=twin.ignored), twin.state)
    mapped = torch.vmap(awake(case).step)(*wrong, twin.state)
    assert (mapped[1].ignored - twin.ignored).tolist() == [0, 1, 0]


def test_what_is_shared_by_a_batch_counts_for_all():
    agent = DNSarsa(3).spread(2)
    seen = {"match": torch.zeros(2, 3)}
    agent(seen, torch.tensor(math.nan), torch.zeros(3))
    agent(seen, torch.tensor(0.0), torch.full((3,), math.inf))
    agent({"match": torch.full((3,), math.nan)}, torch.tensor(0.0), torch.zeros(3))
    assert agent.ignored.tolist() == [3, 3]
    assert all(x.isfinite().all() for x in agent.snapshot().values())


def test_a_long_life_with_bad_numbers_loses_nothing():
    case = AGENTS["DNSarsa"]
    agent = case.build()
    agent.weights.uniform_(0, 1, generator=torch.Generator().manual_seed(0))
    for k, inputs in enumerate(stream(case, 200)):
        agent(*(spoilt(inputs, k % 3, BAD[k % 3])[0] if k % 7 == 0 else inputs))
    assert agent.ignored == 29 and agent.weights.isfinite().all() and agent.weights.any()


def test_senses_are_named_and_others_are_dropped():
    agent = DNSarsa(3)
    reward, noise = torch.tensor(0.0), torch.zeros(3)
    assert agent.senses == ("match",)
    agent({"match": torch.zeros(3), "image": torch.full((2,), math.nan)}, reward, noise)
    assert agent.ignored == 0
    with pytest.raises(ValueError, match=r"lacks 'match', it has \['image'\]"):
        agent({"image": torch.zeros(3)}, reward, noise)
    with pytest.raises(TypeError, match="observation is a Tensor: give a dict of tensors by name"):
        agent(torch.zeros(3), reward, noise)
    assert AGENTS["DNSarsa, Repertoire"].build().senses == ("image", "proximity")


def test_numbers_of_another_precision_are_those_of_the_agent():
    agent, twin = DNSarsa(3), DNSarsa(3)
    for x in (agent, twin):
        x.learner.trace.u.fill_(0.3)
    match, noise = torch.tensor([1.0, 0.2, 0.1]), torch.rand(3)
    for _ in range(3):
        fine = {"match": match.double()}, torch.tensor(1.0).double(), noise.double()
        assert torch.equal(agent(*fine), twin({"match": match}, torch.tensor(1.0), noise))
    assert_same(agent.state, twin.state)
    _, state = agent.step(*fine, agent.state)
    agent.step(*fine, state)
    agent(fine[0], torch.tensor(1e300, dtype=torch.float64), noise)
    assert agent.ignored == 1 and agent.weights.isfinite().all()


def test_a_huge_match_breaks_nothing():
    agent = DNSarsa(3)
    for huge in (1e38, -1e38, 1e30):
        for _ in range(40):
            seen = {"match": torch.tensor([huge, 0.0, 0.5])}
            agent(seen, torch.tensor(1.0), torch.zeros(3))
    assert all(x.isfinite().all() for x in agent.snapshot().values())

"""Random numbers that depend on what they are for."""

import pytest
import torch
from scipy import stats

from dntorch.modules.sarsa import DNSarsa
from dntorch.noise import MASK, Exploration, keyed_uniform, philox

#: Known answers of Random123 (file kat_vectors): counter, key, output of philox4x32-10.
KNOWN = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000",
     "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff",
     "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0",
     "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip


def words(text):
    return [torch.tensor(int(word, 16)) for word in text.split()]


@pytest.mark.parametrize(("counter", "key", "output"), KNOWN)
def test_generator_is_philox_4x32_10(counter, key, output):
    assert philox(words(counter), words(key)) == words(output)


def python_philox(counter, key):
    """The definition, in Python's integers of any size."""
    (c0, c1, c2, c3), (k0, k1) = counter, key
    for _ in range(10):
        first, second = 0xD2511F53 * c0, 0xCD9E8D57 * c2
        c0, c1, c2, c3 = (
            (second >> 32) ^ c1 ^ k0,
            second & MASK,
            (first >> 32) ^ c3 ^ k1,
            first & MASK,
        )
        k0, k1 = (k0 + 0x9E3779B9) & MASK, (k1 + 0xBB67AE85) & MASK
    return [c0, c1, c2, c3]


def test_draws_are_the_words_for_seed_agent_occasion_and_stream():
    seed, agent, occasion, stream = MASK, 4_000_000_000, 123, 9
    draws = keyed_uniform(seed, torch.tensor(agent), torch.tensor(occasion), 6, stream)
    expected = [
        word / 2**32
        for block in (0, 1)
        for word in python_philox([block, occasion, agent, 0], [seed, stream])
    ]
    assert draws.tolist() == expected[:6]


def test_a_draw_is_the_same_alone_and_in_any_batch():
    agents = torch.arange(60).view(3, 20)
    occasions = (7 * agents) % 11
    together = keyed_uniform(5, agents, occasions, 9, 1)
    assert together.shape == (3, 20, 9)
    for index in [(0, 0), (1, 7), (2, 19)]:
        assert torch.equal(keyed_uniform(5, agents[index], occasions[index], 9, 1), together[index])


def test_asking_for_more_numbers_does_not_change_the_first_ones():
    few, many = (keyed_uniform(5, torch.tensor(3), torch.tensor(2), count, 1) for count in (3, 11))
    assert torch.equal(few, many[:3]) and many.unique().numel() == 11


def test_every_part_of_the_key_matters():
    base = {"seed": 1, "agent": torch.tensor(2), "occasion": torch.tensor(3), "stream": 4}
    first = keyed_uniform(**base, count=4)
    for name, value in base.items():
        assert not torch.equal(keyed_uniform(**{**base, name: value + 1}, count=4), first)


def draws(seed=0, agents=200, occasions=50, count=16, stream=1):
    agent = torch.arange(agents).unsqueeze(-1).expand(-1, occasions)
    occasion = torch.arange(occasions).expand(agents, -1)
    return keyed_uniform(seed, agent, occasion, count, stream)


def counts(*samples, bins=8):
    """How often each combination of bins occurs."""
    cell = sum((x * bins).long().flatten() * bins**k for k, x in enumerate(samples))
    return torch.bincount(cell, minlength=bins ** len(samples)).numpy()


@pytest.mark.parametrize("seed", [0, 1, MASK])
def test_draws_are_uniform(seed):
    sample = draws(seed)
    assert 0 <= sample.min() and sample.max() < 1
    assert stats.chisquare(counts(sample, bins=100)).pvalue > 0.001
    assert stats.kstest(sample.flatten()[:50_000].numpy(), "uniform").pvalue > 0.001


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [
        ("agents", lambda: draws()[:-1], lambda: draws()[1:]),
        ("occasions", lambda: draws()[:, :-1], lambda: draws()[:, 1:]),
        ("numbers of a draw", lambda: draws()[..., :-1], lambda: draws()[..., 1:]),
        ("streams", draws, lambda: draws(stream=2)),
        ("seeds", draws, lambda: draws(seed=1)),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_draws_for_neighbours_are_independent(name, first, second):
    assert stats.chisquare(counts(first(), second())).pvalue > 0.001


# Exploration


def test_exploration_is_drawn_anew_at_each_decision_and_only_then():
    noise = Exploration(4, seed=3, agents=5)
    first = noise(torch.tensor(0)).clone()
    assert torch.equal(noise(torch.tensor(0)), first)
    second = noise(torch.tensor(1)).clone()
    assert not torch.equal(first, second)
    assert torch.equal(noise(torch.tensor(0)), first)  # no hidden generator


def test_exploration_of_one_agent_does_not_depend_on_its_batch_or_dtype():
    decisions = torch.tensor([4, 0, 9])
    together = Exploration(3, seed=8, agents=[11, 2, 70])(decisions, torch.float64)
    for k, agent in enumerate((11, 2, 70)):
        alone = Exploration(3, seed=8, agents=agent)
        assert torch.equal(alone(decisions[k], torch.float64), together[k])
        assert torch.equal(alone(decisions[k]), together[k].float())


def test_a_change_of_dtype_alone_is_noticed():
    noise, decisions = Exploration(3, seed=8), torch.tensor(4)
    assert noise(decisions).dtype == torch.float32
    assert noise(decisions, torch.float64).dtype == torch.float64


def test_a_counter_that_moves_in_place_is_noticed():
    agent, noise = DNSarsa(3), Exploration(3, seed=8)
    before = noise(agent.decisions).clone()
    agent.decisions += 1
    assert not torch.equal(noise(agent.decisions), before)


def test_exploration_lies_between_zero_and_its_amplitude():
    sample = Exploration(4, seed=0, agents=torch.arange(1000), amplitude=3.0)(
        torch.zeros(1000, dtype=torch.int64)
    )
    assert sample.shape == (1000, 4)
    assert 0 <= sample.min() < 0.01 and 2.99 < sample.max() <= 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed=-1: give a whole number from 0"),
        ({"seed": 2**32}, "seed=4294967296: give a whole number from 0"),
        ({"agents": [0, -1]}, r"agents=\[0, -1\]: give whole numbers from 0"),
        ({"agents": 2**40}, "agents=1099511627776: give whole numbers from 0"),
        ({"agents": [0.5]}, r"agents=\[0.5\]: give whole numbers from 0"),
        ({"amplitude": 0.0}, "amplitude=0.0 must be positive: for none, pass zeros"),
    ],
)
def test_wrong_arguments_name_argument_value_and_remedy(options, message):
    with pytest.raises(ValueError, match=message):
        Exploration(**{"n": 4, "seed": 0, **options})


def test_what_a_call_returns_may_be_edited():
    explore, decisions = Exploration(4, seed=0), torch.tensor(3)
    first = explore(decisions)
    for _ in range(3):
        noise = explore(decisions)
        assert torch.equal(noise, first)
        noise *= 0.5


@pytest.mark.parametrize(
    ("name", "value"),
    [("amplitude", 1), ("seed", 7), ("agents", torch.tensor(5)), ("amplitude", 2.5)],
)
def test_settings_count_at_once(name, value):
    explore, decisions = Exploration(4, seed=0), torch.tensor(3)
    before = explore(decisions)
    setattr(explore, name, value)
    settings = {"seed": 0, "agents": 0, "amplitude": 10.0} | {name: value}
    assert torch.equal(explore(decisions), Exploration(4, **settings)(decisions))
    assert not torch.equal(explore(decisions), before)


def test_a_setting_of_ones_own_for_each_agent():
    seeds, sizes = torch.tensor([3, 8]), torch.tensor([1.0, 5.0])
    both = Exploration(3, seeds, [0, 4], sizes)
    decisions = torch.tensor([2, 6])
    for k, (seed, agent, size) in enumerate([(3, 0, 1.0), (8, 4, 5.0)]):
        alone = Exploration(3, seed, agent, size)
        torch.testing.assert_close(both(decisions)[k], alone(decisions[k]))


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", -1), ("seed", 2**32), ("seed", 1.5), ("amplitude", 0), ("amplitude", float("nan"))],
)
def test_a_wrong_setting_is_refused_whenever_it_is_set(name, value):
    explore = Exploration(4, seed=0)
    with pytest.raises(ValueError, match=f"{name}="):
        setattr(explore, name, value)
    with pytest.raises(ValueError, match=f"{name}="):
        Exploration(4, **({"seed": 0} | {name: value}))
    assert explore.seed == 0 and explore.amplitude == 10.0


def test_settings_that_are_tensors_may_be_edited_or_learned():
    size = torch.tensor([1.0, 2.0])
    explore, decisions = Exploration(3, 0, [0, 1], size), torch.tensor([2, 6])
    explore(decisions)
    explore.amplitude[0] = 9.0
    expected = Exploration(3, 0, [0, 1], torch.tensor([9.0, 2.0]))
    assert torch.equal(explore(decisions), expected(decisions))
    learned = torch.tensor([1.0, 2.0], requires_grad=True)
    explore.amplitude = learned
    with torch.no_grad():
        explore(decisions)
    for _ in range(2):
        explore(decisions).sum().backward()
    assert (learned.grad > 0).all()


@pytest.mark.parametrize(
    "settings", [{"n": 2.5}, {"n": -1}, {"seed": None}, {"seed": True}, {"amplitude": "x"}]
)
def test_settings_that_are_no_numbers_are_refused(settings):
    with pytest.raises(ValueError, match=f"{next(iter(settings))}="):
        Exploration(**({"n": 3, "seed": 0} | settings))

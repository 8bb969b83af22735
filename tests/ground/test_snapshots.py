"""What is put in the place of a structure's tensors fits as a whole, or changes nothing."""

import copy
import math

import pytest
import torch
from structures import (
    CASES,
    N,
    Pair,
    assert_same,
    awake,
    every_structure,
    every_structure_with_state,
    mixed,
    over,
    small_camera,
    stream,
)
from torch import nn
from torch.utils._pytree import tree_flatten, tree_leaves, tree_map, tree_unflatten

from dntorch import DNF, DNSarsa, FindColor, HebbianQ, Learner, NodeWTA, Repertoire

BAD = [math.nan, math.inf, -math.inf]
LEARNING = over({name: case for name, case in CASES.items() if case.remembers})
#: Those whose ``forward`` reads a bad number as one: an agent reads it as 0, see test_border.
BARE = over(
    {k: v for k, v in CASES.items() if v.remembers and not k.startswith("DNSarsa")}
)  # fmt: skip

# State


@every_structure_with_state
def test_a_state_that_is_wrong_in_one_place_changes_nothing(case):
    module = awake(case)
    held = module.snapshot()
    leaves, form = tree_flatten(module.state)
    for k, leaf in enumerate(leaves):
        given = [2 * x + 1 for x in leaves]
        given[k] = leaf.expand(4, *leaf.shape)
        with pytest.raises(ValueError, match=r"of shape \[4.*\] does not fit .*call (resize|spr)"):
            module.state = tree_unflatten(given, form)
        assert_same(module.snapshot(), held)


@every_structure
@pytest.mark.parametrize("wrong", [None, 5, "rest", (1, 2), torch.zeros(3)])
def test_what_is_no_state_is_named(case, wrong):
    module = awake(case)
    held = module.snapshot()
    with pytest.raises((TypeError, ValueError), match=r"state|call (resize|spread)"):
        module.state = wrong
    assert_same(module.snapshot(), held)


def test_a_state_that_lacks_a_name_of_a_body_is_named():
    body = mixed()
    state = body.state
    lacking = {k: x for k, x in state.items() if k != "parts.1.near.u"}
    with pytest.raises(ValueError, match=r"the state has no parts\.1\.near\.u"):
        body.state = lacking
    with pytest.raises(ValueError, match=r"the state has one parts\.9\.near\.u"):
        body.state = state | {"parts.9.near.u": torch.zeros(8)}


def test_inputs_of_another_batch_leave_all_parts_as_they_were():
    agent = DNSarsa(3)
    held = agent.snapshot()
    with pytest.raises(ValueError, match="call resize"):
        agent({"match": torch.ones(3)}, torch.tensor(1.0), torch.zeros(8, 3))
    assert_same(agent.snapshot(), held)


# What was learned, and bad numbers


@BARE
@pytest.mark.parametrize("bad", BAD)
def test_a_bad_number_is_refused_before_it_erases_what_was_learned(case, bad):
    for batch in ((), (2,)):
        module = awake(case, *batch)
        held = module.snapshot()
        (inputs,) = stream(case, 1, *batch)
        for k in range(len(inputs)):
            spoilt = [tree_map(torch.clone, x) for x in inputs]
            tree_leaves(spoilt[k])[0].view(-1)[0] = bad
            for _ in range(2):  # through the activation, too
                try:
                    module(*spoilt)
                except ValueError as error:
                    assert "not finite, and" in str(error) or "beyond all" in str(error)
            assert all(module.snapshot()[name].isfinite().all() for name in module.state_dict())
            module.restore(held)


def test_the_bad_input_is_named():
    learner, on = Learner(2), torch.ones(2)
    held = learner.snapshot()
    with pytest.raises(ValueError, match=r"reward is not finite, and values\.weights would not"):
        learner(on, on, torch.tensor(math.nan))
    assert_same(learner.snapshot(), held)
    values, one = HebbianQ(2), torch.tensor(1.0)
    with pytest.raises(ValueError, match=r"trace is not finite, and weights would not be"):
        values(torch.zeros(2, 2), torch.full((2, 2), math.inf), one, one)
    learner.trace.u.fill_(math.nan)
    with pytest.raises(ValueError, match=r"trace\.u is not finite.*call reset\(\)"):
        learner(on, on, one)
    learner.reset()
    learner(on, on, one)


def test_what_would_grow_beyond_all_numbers_is_refused_and_large_numbers_are_not():
    values, zero, one = HebbianQ(2), torch.tensor(0.0), torch.tensor(1.0)
    values.weights.fill_(3e38)
    assert values.weights.sum().isinf()
    values(torch.zeros(2, 2), torch.ones(2, 2), zero, one)
    held = values.snapshot()
    with pytest.raises(ValueError, match="weights would grow beyond all numbers"):
        values(torch.zeros(2, 2), torch.full((2, 2), 3e38), zero, torch.tensor(3e38))
    assert_same(values.snapshot(), held)
    wanted = one.clone().requires_grad_()
    values(torch.zeros(2, 2), torch.ones(2, 2), zero, wanted)  # without a warning


# Checkpoints


@LEARNING
@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("within", [lambda m: m, lambda m: nn.Sequential(m)], ids=["", "within"])
def test_a_wrong_checkpoint_changes_nothing(case, strict, within):
    module = awake(case)
    whole, held = within(module), module.snapshot()
    good = {name: 2 * x + 1 for name, x in whole.state_dict().items()}
    name = list(good)[-1]
    wrong = {
        "shape": good[name].expand(4, *good[name].shape),
        "size": good[name][..., :-1],
        "nan": torch.full_like(good[name], math.nan),
        "inf": torch.full_like(good[name], math.inf),
        "too large for float32": torch.full_like(good[name], 1e300, dtype=torch.float64),
        "no tensor": None,
    }
    for kind, value in wrong.items():
        with pytest.raises((ValueError, TypeError), match=name.rpartition(".")[2]) as raised:
            whole.load_state_dict(good | {name: value}, strict)
        assert "\n" not in str(raised.value), kind
        assert_same(module.snapshot(), held)
    whole.load_state_dict(good, strict)
    assert_same(whole.state_dict(), good)


@LEARNING
def test_a_checkpoint_of_other_names_changes_nothing(case):
    module = awake(case)
    held, good = module.snapshot(), {k: 2 * x + 1 for k, x in module.state_dict().items()}
    with pytest.raises(ValueError, match=r"the state_dict has one more, .* has no: build the"):
        module.load_state_dict(good | {"more": torch.zeros(2)})
    with pytest.raises(ValueError, match=r"the state_dict has no .*(weights|suppression|trace)"):
        module.load_state_dict({})
    assert_same(module.snapshot(), held)
    module.load_state_dict({"more": torch.zeros(2)}, strict=False)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("tau", 0.01), ("tau", -1.0), ("tau", math.nan), ("h", 3.0), ("h", math.inf)],
)
def test_a_learned_number_that_the_constructor_refuses_is_not_loaded(name, wrong):
    def built():
        return NodeWTA(3, tau=nn.Parameter(torch.tensor(0.3)), h=nn.Parameter(torch.tensor(-5.0)))

    for nodes, prefix in ((built(), ""), (nn.ModuleDict({"nodes": built()}), "nodes.")):
        before = copy.deepcopy(nodes.state_dict())
        given = {f"{prefix}tau": torch.tensor(0.2), f"{prefix}h": torch.tensor(-4.0)}
        with pytest.raises(ValueError, match=rf"{name}"):
            nodes.load_state_dict(given | {prefix + name: torch.tensor(wrong)})
        assert_same(nodes.state_dict(), before)
        nodes.load_state_dict(given)
        assert_same(nodes.state_dict(), given)


def test_a_learned_kernel_that_the_constructor_refuses_is_not_loaded():
    field = DNF(9)
    field.kernel_0 = nn.Parameter(field.kernel_0)
    before = field.kernel_0.detach().clone()
    with pytest.raises(ValueError, match="kernel_0 is not finite"):
        field.load_state_dict({"kernel_0": torch.full_like(before, math.nan)})
    assert torch.equal(field.kernel_0, before)


@LEARNING
def test_a_snapshot_with_lost_values_is_refused(case):
    module = awake(case)
    held = module.snapshot()
    for name in case.remembers:
        with pytest.raises(ValueError, match=f"{name} is not finite"):
            module.restore(held | {name: torch.full_like(held[name], math.nan)})
        assert_same(module.snapshot(), held)


# Parts that were built in


@pytest.mark.parametrize(
    "change",
    [
        lambda body: body.parts.append(FindColor("GB")),
        lambda body: body.parts.insert(0, FindColor("GB")),
        lambda body: body.parts.extend([FindColor("GB")]),
        lambda body: body.parts.pop(0),
        lambda body: body.parts.__setitem__(0, FindColor("GB")),
        lambda body: body.parts.__delitem__(0),
        lambda body: body.parts.__iadd__([FindColor("GB")]),
        lambda body: body.parts.add_module("2", FindColor("GB")),
        lambda body: setattr(body, "parts", nn.ModuleList([FindColor("GB")])),
        lambda body: setattr(body, "parts", None),
    ],
)
def test_the_parts_of_a_body_stay_as_they_were_built(change):
    body = Repertoire(small_camera(), FindColor("RG"))
    parts = list(body.parts)
    with pytest.raises(ValueError, match=r"fixed when a Repertoire is built.*build another"):
        change(body)
    assert list(body.parts) == parts and body.n == 5
    twin = copy.deepcopy(body)
    assert type(twin.parts) is type(body.parts) and len(twin.parts) == 2


def test_a_part_that_is_no_argument_is_replaced_by_one_of_its_kind_and_size():
    eye = small_camera().resize(2)
    other = DNF((12, 13))
    eye.perception = other
    assert eye.perception is other and other.u.shape == (2, 12, 13)
    for wrong, message in (
        (DNF((5, 5)), r"perception has a state of shapes .*\[5, 5\].*\[12, 13\]"),
        (DNF((12, 13), dt=1 / 64), r"perception\.dt=0\.015625 does not fit"),
        (NodeWTA(3), "perception=.* is no DNF: give one"),
        (nn.Linear(3, 3), "perception=.* is no DNF: give one"),
        (None, "perception=None is no DNF: give one"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            eye.perception = wrong
        assert eye.perception is other
    pair = Pair()
    with pytest.raises(ValueError, match="right has a state of shapes"):
        pair.right = Learner(N + 1)

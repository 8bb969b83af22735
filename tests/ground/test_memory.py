"""What outlives a reset: long-term memory, counts, and what tensors made in inference mode do."""

import copy
from typing import NamedTuple

import pytest
import torch
from structures import CASES, N, assert_same, awake, every_structure, over, stream
from torch import Tensor
from torch.utils._pytree import tree_map

from dntorch import DNF, DNSarsa, Dynamics, Exploration, HebbianQ, ItemOrderWM
from dntorch.memory import extended

LEARNING = over({name: case for name, case in CASES.items() if case.remembers})


@LEARNING
def test_each_learns_apart_is_taken_out_and_forgets(case):
    module = awake(case, 3)
    for inputs in stream(case, 5, 3):
        module(*inputs)
    learned = {name: module.state_dict()[name].clone() for name in case.remembers}
    assert all(len(x.unique(dim=0)) == 3 for x in learned.values())
    one = module.select(1)
    assert type(one) is type(module) and one is not module
    for name, values in learned.items():
        assert torch.equal(one.state_dict()[name], values[1])
        assert torch.equal(module.state_dict()[name], values)
    assert_same(one.state, one.initial([]))
    many = one.spread(2)
    for name, values in learned.items():
        assert torch.equal(many.state_dict()[name], values[1].expand(2, *values[1].shape))
    many.forget()
    assert not any(values.any() for values in many.state_dict().values())
    assert all(values.any() for values in module.state_dict().values())


@every_structure
def test_a_member_of_a_batch_is_taken_out_at_rest(case):
    module = awake(case, 2, 3)
    for index, remedy in ((6, "0 to 5"), (-7, "0 to 5")):
        with pytest.raises(ValueError, match=f"index={index}: give one of {remedy}"):
            module.select(index)
    one = module.select(4)
    assert_same(one.state, one.initial([]))
    for name, values in module.state_dict().items():
        assert torch.equal(one.state_dict()[name], values[1, 1])
    (inputs,) = stream(case, 1)
    one(*inputs)
    with pytest.raises(ValueError, match="index=0: there is one set"):
        one.select(0)


class TraceState(NamedTuple):
    level: Tensor
    trace: Tensor


class Traced(Dynamics[TraceState]):
    """A structure of one's own, whose memory is an entry of its state."""

    lasting = ("trace",)

    def __init__(self):
        super().__init__(1 / 32)
        self.register_buffer("trace", torch.zeros(4))

    def initial(self, batch: list[int]) -> TraceState:
        return TraceState(self.origin.new_zeros(batch + [4]), extended(self.trace, 1, batch))

    def output(self, state: TraceState) -> Tensor:
        return state.level + state.trace

    def euler(self, input: Tensor, state: TraceState) -> TraceState:
        return TraceState(
            state.level.lerp(input, 0.5), state.trace + self.dt * (state.level - state.trace)
        )


class Forgetful(Traced):
    lasting = ()


def test_memory_of_a_structure_of_ones_own():
    module = Traced().spread(2)
    for _ in range(4):
        module(torch.tensor([[1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 0.0, 1.0]]))
    trace = module.trace.clone()
    module.reset()
    assert torch.equal(module.trace, trace) and not module.level.any()
    assert tuple(module.state_dict()) == ("trace",)
    assert torch.equal(module.select(1).trace, trace[1])
    module.forget()
    assert not module.trace.any()
    torch.jit.script(module)(torch.ones(2, 4))
    with pytest.raises(ValueError, match=r"trace is a persistent buffer.*name it in Forgetful\.l"):
        Forgetful()


class Twice(HebbianQ):
    """A subclass that keeps more."""

    lasting = ("weights", "more")

    def __init__(self, n: int):
        super().__init__(n)
        self.register_buffer("more", torch.ones(n))


def test_memory_that_a_subclass_adds_follows():
    module = Twice(3).spread(2)
    assert tuple(module.more.shape) == (2, 3) and tuple(module.select(1).more.shape) == (3,)
    module.forget()
    assert not module.more.any() and not module.weights.any()


# Counts


def test_decisions_count_over_the_life_of_an_agent():
    agent = DNSarsa(3).spread(2)
    agent.decisions.copy_(torch.tensor([5, 7]))
    agent.ignored.copy_(torch.tensor([1, 2]))
    agent.reset()
    assert agent.decisions.tolist() == [5, 7] and agent.ignored.tolist() == [1, 2]
    assert agent.state.decisions.tolist() == agent.initial([2]).decisions.tolist() == [5, 7]
    assert {"decisions", "ignored"} <= agent.snapshot().keys()
    assert not {"decisions", "ignored"} & agent.state_dict().keys()
    assert agent.select(1).decisions == 7
    assert agent.select(1).spread(3).decisions.tolist() == [7, 7, 7]
    agent.forget()
    assert agent.decisions.tolist() == agent.ignored.tolist() == [0, 0]
    alone = DNSarsa(3)
    alone.decisions.fill_(4)
    assert alone.resize(2).decisions.tolist() == [4, 4]  # the same agent, twice
    assert alone.resize(3).decisions.tolist() == [0, 0, 0]  # others


# Inference mode


@every_structure
@pytest.mark.parametrize(
    "made",
    [
        lambda build, awake: build(), lambda build, awake: awake.resize(), lambda build, awake:
        awake.spread(3), lambda build, awake: awake.spread(3).select(1), lambda build, awake:
        copy.deepcopy(awake), lambda build, awake: awake.double().float(),
    ],
    ids=["built", "resized", "spread", "selected", "copied", "moved"],
)  # fmt: skip
def test_what_is_made_in_inference_mode_works_outside(case, made):
    module = case.build()
    with torch.inference_mode():
        module = made(case.build, module)
        (inputs,) = stream(case, 1, *module.origin.shape)
        module(*inputs)
    assert not any(buffer.is_inference() for buffer in module.buffers())
    batch = list(module.origin.shape)
    watched = tree_map(
        lambda x: x.clone().requires_grad_() if x.is_floating_point() else x.clone(),
        next(stream(case, 1, *batch)),
    )
    module(*watched)
    module.reset()
    module.state = module.initial(batch)


def test_exploration_of_inference_mode_works_outside():
    explore, agent = Exploration(3, seed=0), DNSarsa(3)
    with torch.inference_mode():
        explore(agent.decisions)
    gain = torch.tensor(1.0, requires_grad=True)
    noise = explore(agent.decisions) * gain
    agent({"match": torch.zeros(3)}, torch.tensor(0.0), noise)
    noise.sum().backward()
    assert gain.grad > 0


# Precision


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
@LEARNING
def test_long_term_memory_is_not_rounded_away(case, dtype):
    module = case.build()
    held = {name: x.clone() for name, x in module.named_buffers()}
    with pytest.raises(ValueError, match=rf"dtype={dtype} is too coarse for .*keep float32"):
        module.to(dtype)
    with pytest.raises(ValueError, match="too coarse"):
        torch.nn.Sequential(module).to(dtype)
    assert_same(dict(module.named_buffers()), held)
    assert DNF(9).to(dtype)(torch.ones(9, dtype=dtype)).dtype == dtype


# What a step gives belongs to the caller


@every_structure
def test_an_output_may_be_edited(case):
    module = awake(case)
    for inputs in stream(case, 3):
        given = tree_map(Tensor.clone, (inputs, module.state))
        output, state = module.step(*inputs, module.state)
        kept, before = tree_map(Tensor.clone, state), module.state
        for x in torch.utils._pytree.tree_leaves(output):
            x.fill_(7.0)
        assert_same(state, kept)
        assert_same((inputs, module.state), given)
        for x in torch.utils._pytree.tree_leaves(module(*inputs)):
            held = module.state
            x.fill_(7.0)
            assert_same(module.state, held)
        module.state = before


# Bounds


@pytest.mark.parametrize(
    ("n", "pulses", "size"),
    [(8, 64, 1.0), (4, 1, 40.0), (2, 4, 1e6), (4, 3, 1e-3), (4, 2, 2e38), (3, 2, float("inf"))],
)
def test_activity_stays_between_0_and_1_for_any_pulses(n, pulses, size):
    memory, pulse = ItemOrderWM(n), torch.zeros(n * n)
    pulse[:pulses] = size
    for step in range(400):
        u = memory(pulse.view(n, n) * (step % 40 < 20))
        assert u.min() >= 0 and u.max() <= 1 + 1e-6
    assert u.isfinite().all()


def test_spread_refuses_what_memory_does_not_extend_to_and_changes_nothing():
    values = HebbianQ(N).spread(2)
    with pytest.raises(ValueError, match="call select"):
        values.spread(3)
    assert tuple(values.origin.shape) == (2,) and values.weights.shape == (2, N, N)

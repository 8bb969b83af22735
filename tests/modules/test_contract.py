"""What every structure promises, whatever it computes."""

import copy
import pickle

import pytest
import torch
from structures import (
    CASES,
    COMPILERS,
    assert_same,
    awake,
    buffers,
    differ,
    every_structure,
    every_structure_with_state,
    exported,
    jit,
    long_term,
    scrambled,
    stream,
    watched,
)
from torch import Tensor, nn
from torch.utils._pytree import tree_leaves, tree_map

from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.find_color import FindColor
from dntorch.modules.learner import Learner
from dntorch.modules.node import NodeWTA
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.sensorimotor import Direct
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM


@every_structure
def test_forward_is_step_and_memory(case):
    module = awake(case)
    for inputs in stream(case, 5):
        output, state = module.step(*inputs, module.state)
        assert_same(module(*inputs), output)
        assert_same(module.state, state)


@every_structure
def test_a_step_moves_every_part_of_the_state(case):
    """Or tests of the state could pass on a structure that stands still."""
    module = awake(case)
    before = module.flat(module.state)
    for inputs in stream(case, 20):
        module(*inputs)
    stay = {"ignored", "failures"}  # since all is finite, and nothing waits long enough
    if isinstance(inputs[0], dict) and "image" in inputs[0]:
        stay.add("decisions")  # an arbitrary image satisfies no behaviour
    for name, new in module.flat(module.state).items():
        assert not torch.equal(before[name], new) or name in stay


@every_structure
def test_step_is_pure(case):
    module = awake(case)
    (inputs,) = stream(case, 1)
    arguments = *inputs, scrambled(module.state, seed=3)
    given, held = tree_map(Tensor.clone, arguments), buffers(module)
    first, second = module.step(*arguments), module.step(*arguments)
    assert_same(arguments, given)
    assert_same(buffers(module), held)
    assert_same(first, second)


@every_structure_with_state
def test_state_is_a_snapshot(case):
    module = awake(case)
    snapshot = module.state
    kept = tree_map(Tensor.clone, snapshot)
    for inputs in stream(case, 3):
        module(*inputs)
    assert_same(snapshot, kept)
    assert differ(module.state, kept)


@every_structure
def test_a_state_that_is_set_is_copied_and_cut_off_from_the_graph(case):
    module = awake(case)
    state = watched(scrambled(module.state))
    module.state = state
    kept = tree_map(lambda x: x.detach().clone(), state)
    with torch.no_grad():
        for leaf in tree_leaves(state):
            leaf.zero_()
    assert_same(module.state, kept)
    assert not any(leaf.requires_grad for leaf in tree_leaves(module.state))


@every_structure_with_state
def test_a_state_of_a_wrong_shape_is_refused_with_a_remedy(case):
    module = awake(case)
    held = module.state
    with pytest.raises(
        ValueError, match=r"of shape \[4.*\] do(es)? not fit .*: call (resize|spread)"
    ):
        module.state = tree_map(lambda x: x.expand(4, *x.shape), held)
    assert_same(module.state, held)


@every_structure_with_state
def test_inputs_of_another_batch_are_refused_with_a_remedy(case):
    module = awake(case)
    (inputs,) = stream(case, 1, 4)
    with pytest.raises(ValueError, match=r"call (resize|spread)"):
        module(*inputs)


@every_structure_with_state
def test_gradients_flow_through_time_but_not_out_of_forward(case):
    module, (early, late) = awake(case), stream(case, 2)
    start = watched(module.state)
    _, state = module.step(*watched(early), start)
    _, state = module.step(*late, state)
    total = sum(leaf.sum() for leaf in tree_leaves(state) if leaf.requires_grad)
    leaves = [leaf for leaf in tree_leaves(start) if leaf.requires_grad]
    assert all(g.isfinite().all() and g.any() for g in torch.autograd.grad(total, leaves))
    module(*early)
    assert not any(leaf.requires_grad for leaf in tree_leaves(module.state))


# Rest, batch, memory


@every_structure
def test_reset_forgets_activation_and_keeps_batch_and_values(case):
    module = awake(case, 2)
    for inputs in stream(case, 3, 2):
        module(*inputs)
    learned, addresses = long_term(module), {n: b.data_ptr() for n, b in module.named_buffers()}
    module.reset()
    assert_same(module.state, module.initial([2]))
    assert long_term(module).keys() == learned.keys()
    for name, value in learned.items():
        assert torch.equal(module.state_dict()[name], value) and value.any()
    assert {n: b.data_ptr() for n, b in module.named_buffers()} == addresses  # in place


@every_structure
def test_resize_never_touches_long_term_memory(case):
    module = awake(case)
    learned = long_term(module)
    assert module.resize(5) is module
    for name, value in learned.items():
        assert torch.equal(module.state_dict()[name], value)
    assert_same(module.resize().state, module.initial([]))


@every_structure
def test_two_builds_share_nothing(case):
    module, other = awake(case), awake(case)
    held = other.state
    for inputs in stream(case, 3):
        module(*inputs)
    module.reset()
    assert_same(other.state, held)


@every_structure
def test_rows_of_a_batch_are_independent_and_equal_to_single_runs(case):
    module = awake(case, 3)
    singles = [awake(case) for _ in range(3)]
    for k, single in enumerate(singles):
        single.state = tree_map(lambda x, k=k: x[k], module.state)
    for inputs in stream(case, 12, 3):
        output = module(*inputs)
        for k, single in enumerate(singles):
            row = tree_map(lambda x, k=k: x[k], inputs)
            assert_same(tree_map(lambda x, k=k: x[k], output), single(*row), exactly=False)
    for k, single in enumerate(singles):
        assert_same(tree_map(lambda x, k=k: x[k], module.state), single.state, exactly=False)


@every_structure
def test_a_batch_may_have_several_dimensions(case):
    flat, grid = awake(case, 6), awake(case, 2, 3)
    grid.state = tree_map(lambda x: x.unflatten(0, (2, 3)), flat.state)
    for inputs in stream(case, 3, 6):
        output = grid(*tree_map(lambda x: x.unflatten(0, (2, 3)), inputs))
        assert_same(tree_map(lambda x: x.flatten(0, 1), output), flat(*inputs), exactly=False)


@every_structure
def test_vmap_over_step_agrees_with_a_batch(case):
    module = awake(case, 3)
    (inputs,) = stream(case, 1, 3)
    arguments = *inputs, module.state
    alone = awake(case)
    mapped = torch.vmap(alone.step)(*arguments)
    assert_same(mapped, module.step(*arguments), exactly=False)


@every_structure
def test_gradients_of_step_agree_with_differences(case):
    module = awake(case).double()
    (inputs,) = stream(case, 1, dtype=torch.float64)
    leaves = tree_leaves((inputs, scrambled(module.state)))
    floats = [x.requires_grad_() for x in leaves if x.is_floating_point()]
    template = *inputs, module.state

    def function(*floats):
        rest = iter(floats)
        filled = [next(rest) if x.is_floating_point() else x for x in leaves]
        rest = iter(filled)
        output, state = module.step(*tree_map(lambda _: next(rest), template))
        return tuple(x for x in tree_leaves((output, state)) if x.is_floating_point())

    assert torch.autograd.gradcheck(function, floats, fast_mode=True)


# Copies and checkpoints


@every_structure
def test_a_checkpoint_holds_values_and_no_activation(case):
    module = awake(case)
    assert tuple(module.state_dict()) == case.remembers
    other = case.build()
    other.load_state_dict(module.state_dict())
    for name in case.remembers:
        assert torch.equal(other.state_dict()[name], module.state_dict()[name])
    assert not list(module.parameters())


@every_structure
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))], ids=["deepcopy", "pickle"]
)
def test_a_copy_goes_on_to_the_same_numbers(case, copied):
    module = awake(case)
    warm, cold = list(stream(case, 3)), list(stream(case, 8))[3:]
    for inputs in warm:
        module(*watched(inputs))
    twin = copied(module)
    held = module.state
    outputs = [twin(*inputs) for inputs in cold]
    assert_same(module.state, held)
    assert_same([module(*inputs) for inputs in cold], outputs)
    assert_same(module.state, twin.state)


@every_structure
def test_double_moves_everything_and_steps_in_float64(case):
    module = awake(case).double()
    single = awake(case)
    inexact = [b for b in module.buffers() if b.is_floating_point()]
    assert inexact and all(b.dtype == torch.float64 for b in inexact)
    for inputs, rounded in zip(stream(case, 5, dtype=torch.float64), stream(case, 5), strict=True):
        output = module(*inputs)
        assert all(x.dtype == torch.float64 for x in tree_leaves(output))
        assert_same(tree_map(Tensor.float, output), single(*rounded), exactly=False)
    for state in (module.state, module.step(*inputs, module.state)[1], module.initial([2])):
        assert all(x.dtype in (torch.float64, torch.int64) for x in tree_leaves(state))
    module.reset()
    module.resize(2)
    assert all(x.dtype in (torch.float64, torch.int64) for x in tree_leaves(module.state))


@every_structure
def test_everything_moves_to_another_device(case):
    """The meta device has no data, but it mixes with the CPU as little as a GPU does."""
    module = awake(case).to("meta")
    (inputs,) = stream(case, 1)
    output = module(*tree_map(lambda x: x.to("meta"), inputs))
    module.reset()
    module.resize(2)
    for tensor in [*tree_leaves((output, module.state)), *module.buffers()]:
        assert tensor.is_meta


# Compilers


@every_structure_with_state
@pytest.mark.parametrize("translate", COMPILERS, ids=lambda f: f.__name__)
@jit
def test_translated_structures_agree_with_eager(case, translate):
    module = awake(case)
    start = module.state
    inputs = list(stream(case, 20))
    expected = [module(*x) for x in inputs]
    assert differ(module.state, start)
    module.state = start
    # A translation shares its buffers with the module and may step it while it is made.
    original = copy.deepcopy(module)
    twin = translate(original, inputs[0])
    original.state = start
    for x, output in zip(inputs, expected, strict=True):
        assert_same(twin(*x), output)


class Pure(nn.Module):
    """The step as a function of tensors: what goes into ONNX, C++ or a tensordict."""

    def __init__(self, module):
        super().__init__()
        self.module = module

    def forward(self, *arguments):
        output, state = self.module.step(*arguments)
        return output, tree_leaves(state)


@every_structure
def test_the_pure_step_exports_with_a_dynamic_batch(case):
    module = case.build()
    (few,) = stream(case, 1, 3)
    (many,) = stream(case, 1, 5)
    batch = {0: torch.export.Dim("batch")}
    few = *few, scrambled(module.initial([3]))
    many = *many, scrambled(module.initial([5]))
    shapes = (tree_map(lambda _: batch, few),)
    program = torch.export.export(Pure(module), few, dynamic_shapes=shapes).module()
    assert_same(program(*many), Pure(module)(*many))


# The agent


@pytest.mark.parametrize("name", ["DNSarsa", "DNSarsa, FindColor"])
@jit
def test_commands_survive_scripting(name):
    case = CASES[name]
    agent = torch.jit.script(awake(case))
    values = agent.learner.values  # a property such as agent.weights is lost in translation
    (inputs,) = stream(case, 1)
    start = values.weights.clone()
    agent.learn(False)
    agent(*inputs)
    assert torch.equal(values.weights, start)
    agent.learn(True)
    agent(*inputs)
    learned = values.weights.clone()
    assert not torch.equal(learned, start)
    counted = agent.decisions.clone()
    agent.reset()
    assert agent.decisions == counted and (agent.behaviors.intention.u == -5).all()
    assert torch.equal(values.weights, learned)
    agent.forget()
    assert not values.weights.any() and agent.decisions == 0


def test_an_exported_agent_keeps_the_switch_of_learning():
    case = CASES["DNSarsa"]
    (inputs,) = stream(case, 1)
    held = dict((twin := exported(awake(case), inputs)).named_buffers())
    start = held["learner.values.weights"].clone()
    held["learner.values.learning"].fill_(0.0)
    twin(*inputs)
    assert torch.equal(held["learner.values.weights"], start)
    held["learner.values.learning"].fill_(1.0)
    twin(*inputs)
    assert not torch.equal(held["learner.values.weights"], start)


@jit
def test_direct_has_no_state_of_its_own():
    direct, match = Direct(), torch.tensor([0.0, 0.4, 1.0])
    seen = {"match": match}
    assert direct.state == direct.initial([7]) == direct.advance(seen, match, {}) == {}
    assert torch.equal(direct.match(seen, {}), match)
    assert torch.equal(direct.act(match, {}), match)
    assert torch.equal(torch.jit.script(direct)(seen, match / 2), match / 2)


@every_structure_with_state
def test_an_input_that_would_broadcast_in_silence_is_refused(case):
    module = case.build()
    (given,) = stream(case, 1)
    for k, whole in enumerate(given):
        if isinstance(whole, Tensor) and whole.dim() and whole.shape[-1] > 1:
            one = [*given[:k], whole[..., :1], *given[k + 1 :]]
            with pytest.raises(ValueError, match=r"of shape \["):
                module(*one)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ElementaryBehaviors(4, intention=NodeWTA(3)), r"intention\.n=3 .* n=4"),
        (
            lambda: ElementaryBehaviors(4, dt=1 / 64, intention=NodeWTA(4)),
            r"intention\.dt=0\.03125",
        ),
        (lambda: ElementaryBehaviors(4, value_gain=-5.0), r"value_gain=-5\.0 must be positive"),
        (lambda: Learner(4, trace=ItemOrderWM(4, dt=1 / 64)), r"trace\.dt=0\.015625"),
        (lambda: Learner(4, pulses=TPCell((3, 3))), r"pulses\.shape=\(3, 3\)"),
        (lambda: DNSarsa(4, learner=Learner(3)), r"learner.*\.n=3 .* n=4"),
        (lambda: FindColor("RGBY", axle=0.0), r"axle=0\.0 must be positive"),
        (lambda: FindColor("RGBY", hue_centers=[0.0, 1.0, 2.0]), "one for each color of RGBY"),
    ],
)
def test_parts_that_do_not_fit_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_a_body_must_be_a_structure():
    with pytest.raises(TypeError, match="is no Sensorimotor"):
        DNSarsa(4, nn.Linear(4, 4))


def test_a_reward_of_another_shape_leaves_the_agent_as_it_was():
    agent = DNSarsa(3).spread(8)
    before = agent.snapshot()
    for shape in ((1,), (8, 1)):
        with pytest.raises(ValueError, match=r"reward of shape .* does not fit the batch \[8\]"):
            agent({"match": torch.ones(8, 3)}, torch.zeros(shape), torch.zeros(8, 3))
    for name, buffer in agent.snapshot().items():
        assert torch.equal(buffer, before[name])

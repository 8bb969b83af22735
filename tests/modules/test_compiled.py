"""The compiled step, and how much an eager one does."""

import shutil
from collections import Counter

import pytest
import torch
from structures import CASES, over, scrambled, stream
from torch._inductor.utils import run_and_get_code
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

from dntorch import DNSarsa, ElementaryBehaviors, NodeWTA
from dntorch.cells.color import hue_columns

AGENTS = {name: CASES[name] for name in ("DNSarsa", "DNSarsa, FindColor")}
TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-12}
needs_compiler = pytest.mark.skipif(not shutil.which("g++"), reason="needs a C++ compiler")


def innermost(tensor):
    """The same tensor with its batch innermost in memory."""
    return tensor.movedim(0, -1).contiguous().movedim(-1, 0)


def far(tree, other):
    """Largest difference of two trees, relative where numbers are above 1."""
    pairs = zip(tree_leaves(tree), tree_leaves(other), strict=True)
    return max(float(((a - b).abs() / b.abs().clamp_min(1)).max()) for a, b in pairs)


@pytest.mark.parametrize("dtype", TOLERANCE)
@over(AGENTS)
@needs_compiler
def test_alone_in_a_batch_and_compiled_a_step_is_the_same(case, dtype):
    torch.compiler.reset()
    agent = case.build().to(dtype).spread(3)
    alone = case.build().to(dtype)
    compiled = torch.compile(agent.step, fullgraph=True, dynamic=False)
    for k, inputs in enumerate(stream(case, 6, 3, dtype=dtype)):
        state = scrambled(agent.state, seed=k)
        eager = agent.step(*inputs, state)
        assert far(compiled(*inputs, state), eager) < TOLERANCE[dtype]
        row = tree_map(lambda x: x[1], (*inputs, state))
        assert far(alone.step(*row), tree_map(lambda x: x[1], eager)) < TOLERANCE[dtype]


@needs_compiler
def test_the_order_of_a_batch_in_memory_does_not_matter():
    torch.compiler.reset()
    case, batch = CASES["DNSarsa"], 5
    agent = case.build().spread(batch)
    compiled = torch.compile(agent.step, fullgraph=True, dynamic=False)
    (inputs,) = stream(case, 1, batch)
    arguments = *inputs, scrambled(agent.state)
    assert far(compiled(*tree_map(innermost, arguments)), agent.step(*arguments)) < 1e-6


@needs_compiler
def test_the_compiled_hue_map_is_computed_once_and_not_per_hue():
    torch.compiler.reset()
    image = torch.randint(0, 256, (4, 39, 52, 3), dtype=torch.uint8)
    compiled = torch.compile(lambda x: hue_columns(x, 24, 0.35, 0.16), dynamic=False)
    columns, (code, *_) = run_and_get_code(compiled, image)
    assert torch.equal(columns, hue_columns(image, 24, 0.35, 0.16))
    kernels = code.split('extern "C"')
    rounding = [".round()" in kernel or "nearbyint" in kernel for kernel in kernels]
    counting = ["^" in kernel for kernel in kernels]
    assert any(rounding) and any(counting)
    assert not any(a and b for a, b in zip(rounding, counting)), "one kernel does both"
    assert "atomic_add" not in code


class Count(TorchDispatchMode):
    """Counts tensor operations."""

    def __init__(self):
        super().__init__()
        self.operations = Counter()

    def __torch_dispatch__(self, function, types, arguments=(), options=None):
        self.operations[str(function)] += 1
        return function(*arguments, **(options or {}))


@pytest.mark.parametrize(("integrator", "most"), [("euler", 122), ("heun", 220)])
def test_a_step_takes_few_operations(integrator, most):
    """Alone, an agent pays for each operation and not for its size."""
    agent = DNSarsa(4, integrator=integrator)
    inputs = {"match": torch.zeros(4)}, torch.tensor(0.0), torch.zeros(4)
    with torch.no_grad(), Count() as count:
        agent.step(*inputs, agent.state)
    clones = len(tree_leaves(agent.state))  # which the state read above is
    assert count.operations.total() - clones <= most, count.operations.most_common()


@pytest.mark.parametrize("kind", [NodeWTA, ElementaryBehaviors])
def test_a_step_that_composites_would_not_call_is_refused(kind):
    with pytest.raises(TypeError, match=r"Mine writes euler, .* write relax"):
        type("Mine", (kind,), {"euler": lambda self, input, state: state})


def test_nodes_that_relax_otherwise_do_so_in_a_composite():
    class Still(NodeWTA):
        def relax(self, input, output, state):
            return state

    behaviors = ElementaryBehaviors(3, intention=Still(3))
    behaviors(torch.ones(3), torch.ones(3))
    assert (behaviors.intention.u == -5).all() and (behaviors.satisfaction.u > -5).all()

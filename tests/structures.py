"""Every structure of the library once, and what tests of all of them need."""

import io
from collections.abc import Callable
from typing import NamedTuple

import pytest
import torch
from torch import Tensor
from torch.utils._pytree import tree_leaves, tree_map

from dntorch.cells.field import FieldState
from dntorch.cells.kernels import Gauss
from dntorch.dynamics import Dynamics
from dntorch.modules.architecture import Architecture
from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.constraints import Constraints
from dntorch.modules.curiosity import Curiosity
from dntorch.modules.dissatisfaction import Dissatisfaction
from dntorch.modules.field import DNF
from dntorch.modules.find_color import FindColor
from dntorch.modules.habituation import Habituation
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner, LearnerState
from dntorch.modules.memory_trace import MemoryTrace
from dntorch.modules.node import NodeWTA
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.recall import Recall
from dntorch.modules.relay import Relay
from dntorch.modules.repertoire import Repertoire
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.sensorimotor import Direct, Sensorimotor
from dntorch.modules.transient import TPCell
from dntorch.modules.value import ValueNodes
from dntorch.modules.working_memory import ItemOrderWM

N = 3


def unit(*shape):
    """Inputs of a shape, uniform between the two numbers."""
    return lambda batch, generator: torch.rand((*batch, *shape), generator=generator)


def signed(*shape):
    return lambda batch, generator: 2 * torch.rand((*batch, *shape), generator=generator) - 1


def strong(*shape):
    return lambda batch, generator: 8 * torch.rand((*batch, *shape), generator=generator)


def photo(batch, generator):
    image = torch.randint(0, 256, (*batch, 6, 13, 3), generator=generator).to(torch.uint8)
    return {"image": image}


def found(batch, generator):
    """Behaviour 0 sees its condition of satisfaction."""
    match = 0.1 * torch.rand((*batch, N), generator=generator)
    match[..., 0] = 1.0
    return {"match": match}


def some(**draws):
    """An observation: an input under each name."""
    return lambda batch, generator: {k: draw(batch, generator) for k, draw in draws.items()}


def small_camera():
    return FindColor("RGB", hues=12, columns=13)


class WallState(NamedTuple):
    near: FieldState


class KeepAway(Sensorimotor[WallState]):
    """Always on: turns away from where something is near."""

    senses = ("proximity",)
    n = 0

    def __init__(self):
        super().__init__(max_speed=2.0)
        self.near = DNF(8, (Gauss(4.0, 1.0),))

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: WallState
    ) -> WallState:
        return WallState(self.near.euler(8 * observation["proximity"], state.near))

    def act(self, intention: Tensor, state: WallState) -> Tensor:
        rate = self.near.output(state.near)
        left, right = rate[..., :4].sum(-1), rate[..., 4:].sum(-1)
        return torch.stack((left - right, right - left), -1)


def mixed():
    return Repertoire(small_camera(), KeepAway())


def both(batch, generator):
    proximity = torch.rand((*batch, 8), generator=generator)
    return photo(batch, generator) | {"proximity": proximity}


class Case(NamedTuple):
    build: Callable[[], Dynamics]
    inputs: tuple[Callable, ...]
    remembers: tuple[str, ...] = ()
    """Keys of a checkpoint: long-term memory."""


class PairState(NamedTuple):
    left: LearnerState
    right: LearnerState


class Pair(Dynamics[PairState]):
    """Two learners, the second on what the first has chosen: a part is one line."""

    def __init__(self):
        super().__init__(1 / 32)
        self.left, self.right = Learner(N), Learner(N)

    def output(self, state: PairState) -> Tensor:
        return self.left.output(state.left) + self.right.output(state.right)

    def euler(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: PairState
    ) -> PairState:
        return PairState(
            self.left.euler(intention, satisfaction, reward, state.left),
            self.right.euler(satisfaction, intention, reward, state.right),
        )


def patient():
    return ElementaryBehaviors(N, dissatisfaction=Dissatisfaction(N, patience=0.5))


def beyond():
    """An agent with every part that it may have."""
    return DNSarsa(
        N,
        behaviors=patient(),
        recall=Recall(N),
        habituation=Habituation(N, 2),
        constraints=Constraints(N, states=N * N),
        curiosity=Curiosity(N, 3),
    )


def progress(batch, generator):
    return found(batch, generator) | {"lamp": torch.rand((*batch, 1), generator=generator)}


def fields(order=None):
    """Fields of two sizes, nodes, a memory trace and relays, with names of all kinds."""
    return Architecture(
        {
            "scene": DNF((4, 6), ()),
            "u -> u": DNF(6, Gauss(4.0, 1.0)),
            "keys": NodeWTA(3),
            "memory": MemoryTrace(6, tau_build=0.2),
            "sum": Relay(6),
            "gate": Relay(6, "product", "logistic"),
        },
        ("scene", "u -> u", "c p -> p", Gauss(2.0, 1.0)),
        ("u -> u", "scene", "p -> c p"),
        ("u -> u", "memory"),
        ("u -> u", "keys", "p -> k", 2.0),
        ("memory", "sum"),
        ("cue", "sum"),
        ("sum", "gate"),
        ("u -> u", "gate"),
        ("gate", "u -> u", 3.0),
        inputs={"cue": torch.linspace(0, 2, 6)},
        order=order,
    )


def folded():
    parts = {"u": DNF(6), "v": DNF((2, 3), Gauss(4.0, 1.0)), "sum": Relay(3)}
    links = ("u", "sum", "x -> y", 0.1), ("sum", "v", "x -> y x"), ("v", "u", "y x -> z")
    return Architecture(parts, *links).fold()


LATE = ["scene", "u -> u", "memory", "keys", "gate", "sum"]
GIVEN = some(**{"scene": strong(4, 6), "cue": unit(6), "u -> u": strong(6)})
BEYOND = (
    "deliberation.constraints.suppression", "deliberation.curiosity.weights",
    "learner.values.weights",
)  # fmt: skip
PAIR = ("left.values.weights", "right.values.weights")
PAIRS, AGENT = (N, N), ("learner.values.weights",)
CASES = {
    "DNF 1-D": Case(lambda: DNF(9), (strong(9),)),
    "DNF 2-D": Case(lambda: DNF((5, 6), substeps=2, integrator="heun"), (strong(5, 6),)),
    "MemoryTrace": Case(lambda: MemoryTrace((2, 3)), (unit(2, 3),), ("trace",)),
    "Architecture": Case(fields, (GIVEN,), ("elements.memory.part.trace",)),
    "Architecture in order": Case(lambda: fields(LATE), (GIVEN,), ("elements.memory.part.trace",)),
    "Architecture, folded": Case(folded, (some(u=strong(6), sum=unit(3)),)),
    "NodeWTA": Case(lambda: NodeWTA(N), (strong(N),)),
    "TPCell": Case(lambda: TPCell(PAIRS), (unit(*PAIRS),)),
    "ItemOrderWM": Case(lambda: ItemOrderWM(N), (signed(*PAIRS),)),
    "ValueOpposition": Case(
        lambda: ValueOpposition(N), (signed(*PAIRS), unit(*PAIRS), signed(*PAIRS))
    ),
    "HebbianQ": Case(
        lambda: HebbianQ(N), (unit(*PAIRS), unit(*PAIRS), signed(), unit()), ("weights",)
    ),
    "ValueNodes": Case(lambda: ValueNodes(N), (unit(N), signed(*PAIRS), unit(N), unit(N))),
    "ElementaryBehaviors": Case(lambda: ElementaryBehaviors(N), (unit(N), unit(N))),
    "ElementaryBehaviors, patient": Case(patient, (unit(N), unit(N))),
    "Learner": Case(lambda: Learner(N), (unit(N), unit(N), unit()), ("values.weights",)),
    "Learner, many states": Case(
        lambda: Learner(N, states=N * N), (unit(N), unit(N * N), unit()), ("values.weights",)
    ),
    "Recall": Case(lambda: Recall(N, 2), (unit(N),)),
    "Habituation": Case(lambda: Habituation(N, 2), (unit(N), unit(N))),
    "Dissatisfaction": Case(lambda: Dissatisfaction(N, patience=0.5), (unit(N),)),
    "Constraints": Case(
        lambda: Constraints(N), (unit(N), unit(N), unit(N), signed(*PAIRS)), ("suppression",)
    ),
    "Curiosity": Case(lambda: Curiosity(N, 3), (unit(N), unit(1)), ("weights",)),
    "FindColor": Case(small_camera, (photo, unit(N))),
    "Direct": Case(Direct, (some(match=unit(N)), unit(N))),
    "Repertoire": Case(mixed, (both, unit(N))),
    "DNSarsa": Case(lambda: DNSarsa(N), (found, unit(), strong(N)), AGENT),
    "DNSarsa, Heun": Case(
        lambda: DNSarsa(N, substeps=2, integrator="heun"), (found, unit(), strong(N)), AGENT
    ),
    "DNSarsa, FindColor": Case(
        lambda: DNSarsa(N, small_camera()), (photo, unit(), strong(N)), AGENT
    ),
    "DNSarsa, Repertoire": Case(lambda: DNSarsa(N, mixed()), (both, unit(), strong(N)), AGENT),
    "DNSarsa, beyond": Case(beyond, (progress, unit(), strong(N)), BEYOND),
    "a composite of composites": Case(Pair, (unit(N), unit(N), unit()), PAIR),
    "a number as tensor": Case(lambda: NodeWTA(N, tau=torch.tensor(0.2), h=-5), (strong(N),)),
}


def over(cases):
    return pytest.mark.parametrize("case", cases.values(), ids=cases.keys())


every_structure = over(CASES)
every_structure_with_state = over({k: v for k, v in CASES.items() if k != "Direct"})


def stream(case, steps, *batch, dtype=torch.float32):
    """Inputs of some steps, other ones each."""
    generator = torch.Generator().manual_seed(1)
    for _ in range(steps):
        inputs = tuple(draw(batch, generator) for draw in case.inputs)
        yield tree_map(lambda x: x.to(dtype) if x.is_floating_point() else x, inputs)


def scrambled(state, seed=2):
    """A state of the same form in which nodes are on and off and nothing is at rest."""
    generator = torch.Generator().manual_seed(seed)

    def scramble(x):
        if x.is_floating_point():
            return (2 * torch.rand(x.shape, generator=generator) - 1).to(x.dtype)
        return torch.randint(0, 100, x.shape, generator=generator)

    return tree_map(scramble, state)


def awake(case, *batch):
    """A structure in the middle of things, with values of its own for each member of a batch."""
    module = case.build()
    module.spread(*batch)
    module.state = scrambled(module.state)
    return module


def watched(tree):
    """The same tensors, as leaves of a graph."""
    return tree_map(lambda x: x.requires_grad_() if x.is_floating_point() else x, tree)


def assert_same(actual, expected, exactly=True):
    tolerance = {"rtol": 0, "atol": 0} if exactly else {"rtol": 1e-4, "atol": 1e-5}
    actual, expected = tree_leaves(actual), tree_leaves(expected)
    assert len(actual) == len(expected)
    for a, b in zip(actual, expected, strict=True):
        torch.testing.assert_close(a, b, **tolerance)


def differ(a, b):
    return any(not torch.equal(*pair) for pair in zip(tree_leaves(a), tree_leaves(b), strict=True))


def buffers(module):
    return {name: buffer.clone() for name, buffer in module.named_buffers()}


def long_term(module):
    return {name: buffer.clone() for name, buffer in module.state_dict().items()}


# State and step


jit = pytest.mark.filterwarnings(
    "ignore:.*torch.jit:DeprecationWarning",  # deprecated, kept for robots with old stacks
    "ignore::torch.jit.TracerWarning",  # checks of shapes hold for the traced shape
)


def scripted(module, inputs):
    return torch.jit.script(module)


def scripted_and_loaded(module, inputs):
    torch.jit.save(torch.jit.script(module), file := io.BytesIO())
    file.seek(0)
    return torch.jit.load(file)


def frozen(module, inputs):
    return torch.jit.freeze(torch.jit.script(module.eval()))


def traced(module, inputs):
    # A check would run the module twice and find that it has moved on.
    return torch.jit.trace(module, inputs, check_trace=False, strict=False)


def compiled(module, inputs):
    torch.compiler.reset()
    return torch.compile(module, fullgraph=True, backend="eager")


def exported(module, inputs):
    return torch.export.export(module, inputs).module()


COMPILERS = [scripted, scripted_and_loaded, frozen, traced, compiled, exported]

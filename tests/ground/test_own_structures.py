"""What others may write."""

import inspect
from typing import NamedTuple

import pytest
import torch
from own_structures import Both, Derived, Level, LevelState, Named
from structures import compiled, exported, jit, scripted, traced
from torch import Tensor

from dntorch import DNF, DNSarsa, Dynamics, FindColor, NodeWTA, Repertoire, Sensorimotor


@pytest.mark.parametrize("build", [Level, Both, Named])
@pytest.mark.parametrize("translate", [scripted, traced, compiled, exported])
@jit
def test_annotations_may_be_strings_and_bases_generic(build, translate):
    module, inputs = build(3), (torch.tensor([1.0, 0.5, 0.0]),)
    expected = [module(*inputs) for _ in range(5)]
    module.reset()
    twin = translate(module, inputs)
    module.reset()  # which a translation may have stepped
    for output in expected:
        assert torch.equal(twin(*inputs), output)


def test_annotations_may_be_missing():
    module = Derived(3)
    assert torch.equal(module(torch.ones(3)), torch.full((3,), 0.5))
    assert module.state._fields == ("level",)


def test_a_step_written_by_hand_is_kept():
    class Careful(DNF):
        def euler(self, input, state):
            return super().euler(input, state)

    field = Careful(9, integrator="heun")
    stimulus = torch.linspace(0, 8, 9)
    assert torch.equal(field(stimulus), DNF(9, integrator="heun")(stimulus))


class Body(Sensorimotor[LevelState]):
    """A body whose parts the tests leave out."""

    def __init__(self, **others):
        super().__init__(**others)
        self.field = DNF(3)

    def initial(self, batch: list[int]) -> LevelState:
        return LevelState(self.origin.new_zeros(batch + [3]))

    def match(self, observation: dict[str, Tensor], state: LevelState) -> Tensor:
        return state.level


def forgets_memory():
    class Mine(Level):
        lasting = ("level",)

    return Mine(3)


def forgets_the_base():
    class Mine(Level):
        def __init__(self):
            self.n = 3

    return Mine()


def declares_nothing():
    class Mine(Dynamics):
        def __init__(self):
            super().__init__(1 / 32)

    return Mine()


def writes_half():
    class Mine(Dynamics[LevelState]):
        def __init__(self):
            super().__init__(1 / 32)

        def initial(self, batch):
            return LevelState(self.origin.new_zeros(batch))

    return Mine()


def writes_no_rest():
    class Mine(Dynamics[LevelState]):
        def __init__(self):
            super().__init__(1 / 32)

    return Mine()


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (forgets_memory, "names 'level', which is no buffer"),
        (forgets_the_base, r"n can't be set yet: call super\(\).__init__\(dt\) first"),
        (declares_nothing, "Mine declares no state"),
        (writes_half, r"Mine lacks euler\(..., state\), output\(state\)"),
        (writes_no_rest, r"Mine lacks initial\(batch\)"),
        (lambda: Body(), "Body lacks advance"),
        (lambda: Repertoire(Level), "Level, a class: give structures"),
        (lambda: Repertoire([FindColor()]), "is a list: give structures"),
    ],
)
def test_a_forgotten_line_is_named(mistake, message):
    with pytest.raises((ValueError, TypeError, AttributeError), match=message):
        mistake()


def test_a_parameter_of_a_part_is_not_set_on_the_whole():
    with pytest.raises(AttributeError, match=r"set learner\.values\.learning_rate"):
        DNSarsa(3).learning_rate = 0.5


def test_what_a_structure_has_may_be_set_whatever_its_parts_call_so():
    agent = DNSarsa(3)
    agent.__dict__["tau"] = 1.0  # an attribute of its own
    agent.tau = 2.0
    assert agent.tau == 2.0 and agent.learner.trace.tau == 1.0


def test_a_body_is_as_fast_as_its_slowest_part():
    free = FindColor(max_speed=1e9)
    assert Repertoire(free).max_speed == 1e9
    assert Repertoire(FindColor(), FindColor("RG", max_speed=0.5)).max_speed == 0.5


def test_help_shows_the_arguments():
    assert list(inspect.signature(NodeWTA).parameters)[:3] == ["n", "tau", "h"]


def test_a_reserved_name_is_refused():
    class BadState(NamedTuple):
        flat: Tensor

    with pytest.raises(ValueError, match=r"BadState\.flat: every structure has a flat, rename it"):

        class Bad(Dynamics[BadState]):
            pass

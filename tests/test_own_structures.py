"""What others may write."""

from typing import NamedTuple

import pytest
import torch
from own_structures import Both, Derived, Level, Named
from test_contract import compiled, exported, jit, scripted, traced
from torch import Tensor

from dntorch import DNF, Dynamics


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


def test_a_reserved_name_is_refused():
    class BadState(NamedTuple):
        flat: Tensor

    with pytest.raises(ValueError, match=r"BadState\.flat: every structure has a flat, rename it"):

        class Bad(Dynamics[BadState]):
            pass

"""Numbers of kernels in float64, and a field whose output is its activation."""

import torch

from dntorch import DNF, Architecture, Global, Projection


def test_gains_and_global_terms_are_not_rounded_to_float32():
    field = DNF((2, 3), (Global(-0.1),), dtype=torch.float64)
    projection = Projection("x -> x", 3, 3, 0.1, dtype=torch.float64)
    assert field.everywhere.item() == -0.1 and projection.everywhere.item() == 0.1
    assert field.kernel == (Global(-0.1),) and projection.kernel == 0.1
    assert DNF((2, 3), (Global(-0.1),)).kernel == (Global(-0.1),)


def test_a_linear_field_shows_its_activation():
    field = DNF(3, (), kind="linear", steepness=1.0, h=-2.0)
    output, state = field.step(torch.arange(3.0), field.initial([]))
    assert torch.equal(output, state.u)


def test_an_input_that_reaches_nothing_does_not_stop_folding():
    model = Architecture({"u": DNF(4)}, ("cue", "u"), inputs={"cue": torch.ones(4), "idle": 4})
    folded = model.fold()
    for _ in range(8):
        torch.testing.assert_close(model({"idle": torch.ones(4)}), folded({"idle": torch.ones(4)}))

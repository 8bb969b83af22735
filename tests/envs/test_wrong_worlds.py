"""What makes no world, no batch and no action is refused in one sentence."""

import math

import numpy as np
import pytest
import torch

from dntorch.body import Body
from dntorch.envs import NodesWorld, RingWorld
from dntorch.envs.layout import Light, Ring
from dntorch.envs.task import SequenceTask
from dntorch.robot.calibration import Calibration
from dntorch.robot.safety import Limits

HUGE = 10**400
NUMBERS = ["x", None, [1.0], math.nan, HUGE, True, 1j, torch.tensor([1.0, 2.0]), np.ones(2)]
QUANTITIES = {
    SequenceTask: ("reward", "duration", "dt"),
    NodesWorld: ("shortest", "longest", "dwell", "linger"),
    Ring: ("blocks", "radius", "block_size"),
    Light: ("ambient", "diffuse", "specular", "direction", "color"),
    Body: ("wheel_radius", "axle", "speed_cap", "fov", "width", "near", "camera"),
    Limits: ("speed", "watchdog", "check"),
    RingWorld: ("tolerance", "dwell", "dwell_rate"),
    Calibration: ("rotate", "gains", "fov"),
}


@pytest.mark.parametrize("value", NUMBERS, ids=lambda value: repr(value)[:12])
@pytest.mark.parametrize("kind", QUANTITIES)
def test_what_is_no_number_is_named_with_a_remedy(kind, value) -> None:
    for name in QUANTITIES[kind]:
        with pytest.raises(ValueError, match=r"give|choose") as error:
            kind(**{name: value})
        assert f"{name}=" in str(error.value) and "\n" not in str(error.value)[:100]


@pytest.mark.parametrize(
    "kind, arguments",
    [
        (NodesWorld, {"dwell": -1.0}),
        (NodesWorld, {"longest": math.inf}),
        (NodesWorld, {"linger": 1e300}),
        (SequenceTask, {"duration": 1e300}),
        (SequenceTask, {"reward": 1e300}),
        (SequenceTask, {"sequence": None}),
        (SequenceTask, {"colors": 3}),
        (SequenceTask, {"others": 3}),
        (Ring, {"blocks": 2.5}),
        (Ring, {"missing": None}),
        (Ring, {"missing": "BB"}),
        (Ring, {"missing": "X"}),
        (Light, {"direction": (1.0,)}),
        (Light, {"color": "rgb"}),
        (Limits, {"slew": "x"}),
        (Limits, {"slew": math.nan}),
        (NodesWorld, {"task": "GB"}),
        (RingWorld, {"light": None}),
        (RingWorld, {"body": "epuck"}),
        (RingWorld, {"senses": None}),
    ],
)
def test_what_makes_no_world_is_named_with_a_remedy(kind, arguments) -> None:
    with pytest.raises(ValueError, match="give") as error:
        kind(**arguments)
    assert str(error.value).startswith(f"{next(iter(arguments))}=")


WORLDS = {"nodes": NodesWorld(), "ring": RingWorld(senses=("wheels",))}


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("batch", [(), (1,), (2, 3)])
def test_an_action_of_another_size_or_batch_is_refused(name: str, batch) -> None:
    world = WORLDS[name]
    state, size = world.initial(batch), world.actions[0]
    for shape in ((*batch, size + 1), (5, *batch, size), (*batch, 1), (size,) if batch else ()):
        with pytest.raises(ValueError, match=r"of shape .* does not fit .*: begin with"):
            world.step(torch.zeros(shape), state)
    with pytest.raises(ValueError, match=r"is a ndarray: give torch.as_tensor"):
        world.step(np.zeros((*batch, size)), state)
    assert world.step(torch.zeros(*batch, size), state)[0].reward.shape == batch


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("batch", [3, -1, "x", None, (2.5,), (-1,)])
def test_a_batch_that_is_none_is_refused(name: str, batch) -> None:
    with pytest.raises(ValueError, match=r"batch=.*: give a tuple of whole numbers"):
        WORLDS[name].initial(batch)


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("which", ["seed", "agents"])
@pytest.mark.parametrize("value", [-1, 2**32, 2.5, "x", None, math.nan, True, torch.tensor([0.5])])
def test_seeds_and_numbers_are_whole_and_have_32_bits(name: str, which: str, value) -> None:
    with pytest.raises(ValueError, match=f"{which}=.*: give a whole number from 0 to"):
        WORLDS[name].initial((2,), **{which: value})


@pytest.mark.parametrize("name", WORLDS)
def test_a_snapshot_of_another_world_or_batch_is_refused(name: str) -> None:
    world, other = WORLDS[name], WORLDS["ring" if name == "nodes" else "nodes"]
    state = world.initial((2,))
    wrong = [world.snapshot(world.initial((3,))), other.snapshot(other.initial((2,))), {}, None]
    wrong.append([leaf.double() for leaf in world.snapshot(state)])
    for snapshot in wrong:
        with pytest.raises(ValueError, match="the snapshot is not of this"):
            world.restore(snapshot, state)

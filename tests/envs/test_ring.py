"""The ring in torch: a pure world, equal to its parts one by one, and PyBullet's images."""

import colorsys
import math

import numpy as np
import pytest
import torch

from dntorch.body import EPUCK, Body
from dntorch.colors import HUES
from dntorch.envs import Light, Ring, RingWorld, SequenceTask
from dntorch.envs.judge import Judge, JudgeState
from dntorch.envs.layout import DAYLIGHT
from dntorch.envs.pose import Pose
from dntorch.envs.raycast import box_entry, drum_entry
from dntorch.envs.ring import draw_layout
from dntorch.envs.ring_camera import RingCamera

ALL = ("image", "wheels", "proximity")


def leaves(state):
    return torch.utils._pytree.tree_leaves(state)


def drive(world, state, steps, seed=0):
    """Wander at random: outcomes and the last state."""
    generator, outcomes = torch.Generator().manual_seed(seed), []
    for _ in range(steps):
        speeds = torch.rand(*state.wheels.shape, generator=generator) * 2.4 - 1.2
        outcome, state = world.step(speeds, state)
        outcomes.append(outcome)
    return outcomes, state


# ---------------------------------------------------------------------- a pure world


def test_the_step_is_pure_and_any_batch_does():
    world = RingWorld(senses=ALL)
    for batch in ([], [3], [2, 0], [2, 3]):
        state = world.initial(batch, seed=1)
        before = [leaf.clone() for leaf in leaves(state)]
        outcome, after = world.step(torch.full([*batch, 2], 0.5), state)
        assert all(torch.equal(a, b) for a, b in zip(before, leaves(state), strict=True))
        assert [leaf.shape for leaf in leaves(after)] == [leaf.shape for leaf in before]
        assert outcome.observation["image"].shape == (*batch, 39, 52, 3)
        assert outcome.observation["image"].dtype == torch.uint8
        assert outcome.observation["wheels"].shape == (*batch, 2)
        assert outcome.observation["proximity"].shape == (*batch, 8)
        assert outcome.reward.shape == outcome.found.shape == outcome.completed.shape == (*batch,)
        assert all(leaf.shape[: len(batch)] == (*batch,) for leaf in leaves(state))


def test_alone_is_as_in_a_batch_and_under_vmap():
    world = RingWorld(senses=ALL, ring=Ring(block_shape="cylinder"))
    together = world.initial([5], seed=torch.arange(5))
    _, together = drive(world, together, 9)
    action = torch.rand(5, 2)
    outcome, _ = world.step(action, together)
    mapped = torch.vmap(lambda a, s: world.step(a, s)[0].observation["image"])(action, together)
    assert torch.equal(mapped, outcome.observation["image"])
    for k in range(5):
        alone = torch.utils._pytree.tree_map(lambda leaf: leaf[k], together)  # noqa: B023
        one, _ = world.step(action[k], alone)
        for name in ALL:
            assert torch.equal(one.observation[name], outcome.observation[name][k])


def test_compiled_as_eager():
    world = RingWorld(senses=ALL)
    _, state = drive(world, world.initial([4], seed=2), 5)
    action = torch.rand(4, 2)
    expected = world.step(action, state)
    got = torch.compile(world.step, fullgraph=True, dynamic=False)(action, state)
    torch.testing.assert_close(got, expected)
    assert (got[0].observation["image"] != expected[0].observation["image"]).float().mean() < 0.005


def test_what_is_not_sensed_is_not_computed(monkeypatch):
    world = RingWorld(senses=("wheels",))
    monkeypatch.setattr(world.camera, "walls", None)
    assert list(world.observe(world.initial())) == ["wheels"]


def test_images_are_channels_outermost_in_memory():
    image = RingWorld().observe(RingWorld().initial([2]))["image"]
    assert image.movedim(-1, -3).is_contiguous()


def test_layouts_are_those_of_gymnasium_and_agents_have_their_own():
    world = RingWorld()
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence(7)))
    expected = random.permutation(np.repeat(np.arange(4), 4)).tolist()
    assert world.initial(seed=7).layout.tolist() == expected == draw_layout(Ring(), "RGBY", 7)
    many = world.initial([3], seed=7, agents=torch.arange(3)).layout.tolist()
    assert many[0] == expected and many[1] != many[2] != expected != many[1]
    assert many[2] == world.initial(seed=7, agents=2).layout.tolist()
    seeds = world.initial([3], seed=torch.tensor([7, 8, 7])).layout.tolist()
    assert seeds[0] == seeds[2] == expected and seeds[1] != expected


def test_wheels_turn_exactly_are_clipped_and_nan_is_nothing():
    world = RingWorld(senses=("wheels",))
    state = world.initial()
    for _ in range(32):
        outcome, state = world.step(torch.tensor([-50.0, math.inf]), state)
    assert outcome.observation["wheels"].tolist() == [-201.0, 201.0]
    assert float(world.yaw(state)) == pytest.approx(EPUCK.yaw_rate(-1.26, 1.26), rel=1e-6)
    same = world.step(torch.tensor([math.nan, 0.0]), state)[1]
    assert torch.equal(same.wheels, state.wheels)


def test_the_judge_of_a_batch_is_the_judge():
    judge, random = Judge(dwell=0.1), np.random.default_rng(0)
    bearings = np.cumsum(random.normal(0, 0.02, (400, 6, 1)), axis=0) + np.array([0.0, 0.5, -0.5])
    rates = random.choice([0.0, 0.05, 0.2], (400, 6), p=[0.6, 0.35, 0.05])
    state, alone, found = judge.initial([6]), [JudgeState()] * 6, 0
    for seen, rate in zip(bearings, rates, strict=True):
        verdict, state = judge.judge(torch.tensor(seen), torch.tensor(rate), state)
        for k in range(6):
            expected, alone[k] = judge.step(seen[k], rate[k], alone[k])
            assert tuple(part[k].item() for part in verdict) == expected
            assert tuple(part[k].item() for part in state) == alone[k]
            found += expected.found >= 0
    assert found > 10


def test_a_sequence_is_rewarded_when_the_robot_rests_before_its_colors():
    world = RingWorld(SequenceTask(duration=0.5), senses=())
    state, found, rewards = world.initial([2], seed=torch.tensor([3, 4])), [], torch.zeros(2)
    targets = torch.tensor([world.task.colors.index(letter) for letter in "GBYRG"])
    reached = torch.zeros(2, dtype=torch.int64)
    for _ in range(2000):
        bearings = world.bearings(state)
        wanted = state.layout == targets[reached.clamp_max(4)].unsqueeze(-1)
        nearest = torch.where(wanted, bearings, 9.0).abs().argmin(-1, keepdim=True)
        rate = (2 * bearings.gather(-1, nearest)).clamp(-0.9, 0.9) * (reached < 5).unsqueeze(-1)
        outcome, state = world.step(
            rate * EPUCK.axle / (2 * EPUCK.wheel_radius) * torch.tensor([-1, 1.0]), state
        )
        reached = reached + (outcome.found == targets[reached.clamp_max(4)])
        rewards += outcome.reward
        found += outcome.completed.nonzero().flatten().tolist()
    assert sorted(found) == [0, 1]
    assert rewards.tolist() == [2.0 * 16] * 2


# ---------------------------------------------------------------------- rays


def test_gradients_of_bearings_depths_and_distances():
    for shape in ("box", "cylinder"):
        camera = RingCamera(Ring(block_shape=shape), DAYLIGHT, Body(width=7), "RGBY", torch.float64)
        pose = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in
                (0.285, 0.03, 0.2)]  # fmt: skip
        near = camera.distances(*pose) < 0.07
        assert near.any()

        def smooth(*pose, camera=camera, near=near):
            walls = camera.walls(*pose)
            return (
                walls.depth[walls.depth < 9],
                camera.bearings(*pose),
                camera.distances(*pose)[near],
            )

        assert torch.autograd.gradcheck(smooth, pose)


def test_a_drum_has_corners_and_a_box_faces():
    zero, one = torch.zeros(1, dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    corner = drum_entry((2 * one, zero), (one, zero), 0.5)
    assert float(corner) == pytest.approx(1.5)
    turned = math.pi / 24
    d = (math.cos(turned) * one, math.sin(turned) * one)
    middle = drum_entry((2 * d[0], 2 * d[1]), d, 0.5)
    assert float(middle) == pytest.approx(2 - 0.5 * math.cos(turned))
    assert float(box_entry((2 * one, zero), (one, zero + 1e-9), 0.5)) == pytest.approx(1.5)
    assert box_entry((2 * one, zero), (-one, zero), 0.5).isinf()


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"ring": Ring(block_shape="sphere")}, "block_shape='sphere'"),
        ({"ring": Ring(block_shape="mixed")}, "block_shape='mixed'"),
        ({"ring": Ring(block_size=0.02)}, "block_size=0.02"),
        ({"ring": Ring(blocks=15)}, "blocks=15"),
        ({"light": Light(shadow=True)}, "shadow=True"),
        ({"tolerance": 0.3}, "tolerance=0.3"),
        ({"dwell": -1.0}, "dwell=-1.0"),
        ({"senses": ("smell",)}, "senses=('smell',)"),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, name):
    with pytest.raises(ValueError) as error:
        RingWorld(**arguments)
    assert name in str(error.value) and "give" in str(error.value)


@pytest.mark.parametrize("height", [39, 255, 300])
def test_tall_images(height):
    world = RingWorld(body=Body(height=height))
    image = world.observe(world.initial())["image"]
    assert image.dtype == torch.uint8 and (image[0] == 255).all() and (image[-1] == 114).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_on_a_gpu_as_on_a_cpu():
    here, there = RingWorld(senses=ALL), RingWorld(senses=ALL, device="cuda")
    outcomes = []
    for world in (here, there):
        state = world.initial([8], seed=torch.arange(8))
        for _ in range(40):
            outcome, state = world.step(torch.tensor([[0.2, 0.9]] * 8).to(world.device), state)
        outcomes.append(outcome)
    images = [outcome.observation["image"].cpu() for outcome in outcomes]
    assert (images[0] != images[1]).float().mean() < 0.002
    assert torch.equal(outcomes[0].found, outcomes[1].found.cpu())


# ---------------------------------------------------------------------- beside PyBullet


@pytest.mark.parametrize("light", [DAYLIGHT, Light((-0.3, 0.5, 0.4), (1, 0.8, 0.6), 0.3, 0.4, 0.3)])
@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_images_bearings_and_proximity_are_those_of_pybullet(shape, light):
    pytest.importorskip("pybullet")
    from dntorch.envs import sensors
    from dntorch.envs.scene import Scene

    random, ring = np.random.default_rng(0), Ring(block_shape=shape)
    scene, camera = Scene(ring, light), RingCamera(ring, light, EPUCK, "RGBY")
    layout = draw_layout(ring, "RGBY", 5)
    paints = np.array([colorsys.hsv_to_rgb(HUES[letter] / 360, 1, 1) for letter in "RGBY"])
    scene.paint(paints[layout])
    for k in range(24):
        far = (0.0, 0.03, 0.25)[k % 3]
        x, y, yaw = *random.uniform(-far, far, 2), random.uniform(-4, 4) * (k > 0)
        pose = tuple(torch.tensor(value, dtype=torch.float32) for value in (x, y, yaw))
        c, s = math.cos(yaw), math.sin(yaw)
        there = Pose(np.array([x, y, 0]), np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]))
        image = camera.image(camera.walls(*pose), torch.tensor(layout)).numpy().astype(int)
        wrong = abs(image - sensors.image(scene, EPUCK, there)).max(-1) > 2
        assert wrong.mean() <= 0.01
        np.testing.assert_allclose(
            camera.bearings(*pose), sensors.bearings(ring.centers, EPUCK, there), atol=1e-5
        )
        np.testing.assert_allclose(
            camera.proximity(*pose), sensors.proximity(scene, there), rtol=1e-3
        )
    scene.close()

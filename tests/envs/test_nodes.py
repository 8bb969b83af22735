"""The abstract world: what cannot succeed, and the lamp."""

import shutil

import pytest
import torch

from dntorch.envs import NOTHING, NodesWorld, SequenceTask

FAST = {"shortest": 0.5, "longest": 0.5, "dwell": 0.25, "linger": 0.25}
"""Found 24 control steps after the search began: 16 until in view, 8 in view."""


def seek(world, state, *targets, steps=24, rest=12):
    """Seek one behaviour after another (of each agent): found, whether in view, the state."""
    found, seen = [], []
    for target in targets:
        on = torch.nn.functional.one_hot(torch.tensor(target), world.n).float()
        for k in range(steps + rest):
            outcome, state = world.step(on if k < steps else 0 * on, state)
            found.append(outcome.found)
            seen.append(outcome.observation["match"].any(-1))
    return torch.stack(found, -1), torch.stack(seen, -1), state


def finds(found):
    return [x for x in found.tolist() if x != NOTHING]


def table(n=4, **impossible):
    """All is possible but what is named: ``after_2=(0,)``."""
    feasible = torch.ones(n, n, dtype=torch.bool)
    for name, behaviors in impossible.items():
        feasible[list(behaviors), int(name[-1])] = False
    return feasible


def test_what_is_impossible_after_the_last_find_never_comes_into_view():
    world = NodesWorld(**FAST, feasible=table(after_2=(1,), after_0=(2,)))
    found, seen, state = seek(world, world.initial(), 2, 1, steps=100)
    assert finds(found) == [2] and not seen[112:].any()
    found, seen, state = seek(world, state, 0, 1, 0, 2, steps=100)
    assert finds(found) == [0, 1, 0] and not seen[-112:].any()


def test_where_all_is_possible_nothing_changes():
    free, world = NodesWorld(), NodesWorld(feasible=table())
    states, on = [each.initial(agents=torch.arange(3)) for each in (free, world)], torch.eye(4)
    for k in range(1000):
        (expected, states[0]), (got, states[1]) = (
            each.step(on[[k // 200 % 4, 2, k // 150 % 2]], state)
            for each, state in zip((free, world), states)
        )
        leaves = torch.utils._pytree.tree_leaves
        assert all(torch.equal(a, b) for a, b in zip(leaves(expected), leaves(got), strict=True))
    assert states[0].task.recent[0].ne(NOTHING).sum() == 3


def test_the_time_stands_still_while_it_is_impossible():
    """10 steps of the search count after the table has become another."""
    never = NodesWorld(**FAST, feasible=torch.zeros(4, 4, dtype=torch.bool))
    found, _, state = seek(never, never.initial(), 1, steps=40, rest=0)
    assert finds(found) == [] and state.sought == 0
    found, _, _ = seek(NodesWorld(**FAST), state, 1, steps=40, rest=0)
    assert found.tolist().index(1) == 23


def test_before_the_first_find_it_must_be_possible_after_some_other():
    alone = torch.eye(4, dtype=torch.bool)  # after itself only
    alone[3, 0] = True
    world = NodesWorld(**FAST, feasible=alone)
    assert finds(seek(world, world.initial(), 0, 1, 2, steps=100)[0]) == []
    assert finds(seek(world, world.initial(), 3, steps=100)[0]) == [3]


def test_what_was_found_stays_in_view_though_it_is_impossible_after_itself():
    world = NodesWorld(**FAST, feasible=table(after_1=(1,)))
    found, seen, state = seek(world, world.initial(), 1, steps=60)
    assert finds(found) == [1]
    assert seen.tolist() == [False] * 16 + [True] * (60 - 16 + 8) + [False] * 4
    found, seen, _ = seek(world, state, 0, 1, steps=60)
    assert finds(found) == [0, 1]
    # Sought again after a search in vain for another, it is impossible.
    world = NodesWorld(**FAST, feasible=table(after_1=(1, 2)))
    assert finds(seek(world, world.initial(), 1, 2, 1, steps=60)[0]) == [1]


def test_each_agent_of_a_batch_has_its_table():
    tables = torch.stack([table(after_2=(1,)), table(), table(after_2=(0, 1))])
    world = NodesWorld(**FAST, feasible=tables)
    found, _, together = seek(world, world.initial((3,)), [2] * 3, [1] * 3, [0] * 3)
    assert [finds(row) for row in found] == [[2, 0], [2, 1, 0], [2]]
    for k in range(3):
        alone = NodesWorld(**FAST, feasible=tables[k])
        one, _, state = seek(alone, alone.initial(agents=0), 2, 1, 0)
        assert torch.equal(one, found[k])
        assert torch.equal(state.task.recent, together.task.recent[k])
    shared = NodesWorld(**FAST, feasible=tables[0])
    assert [finds(row) for row in seek(shared, shared.initial((2,)), [2] * 2, [1, 0])[0]] == [
        [2],
        [2, 0],
    ]
    for batch in ((), (2,), (3, 3)):
        with pytest.raises(ValueError, match=r"feasible of batch \[3\] does not fit .*: give"):
            world.initial(batch)


def test_the_lamp_shows_the_progress_after_the_step():
    world = NodesWorld(SequenceTask("GBG", duration=1 / 32), **FAST, senses=("lamp", "match"))
    state = world.initial((2,))
    assert world.observe(state)["lamp"].tolist() == [[0.0], [0.0]]
    on, shown = torch.eye(4), []
    for k in range(4 * 24):
        action = torch.stack([on[[1, 2, 1, 3][k // 24]], on[3]])
        outcome, state = world.step(action, state)
        assert list(outcome.observation) == ["lamp", "match"]
        assert torch.equal(outcome.observation["lamp"], world.observe(state)["lamp"])
        shown.append(outcome.observation["lamp"])
    shown = torch.stack(shown)
    assert shown.shape == (96, 2, 1) and shown.dtype == torch.float32 and not shown[:, 1].any()
    thirds = torch.tensor([0, 1, 2, 3, 0]).repeat_interleave(24)[1:97] / 3
    torch.testing.assert_close(shown[:, 0, 0], thirds)


def test_a_lamp_that_is_not_asked_for_is_not_computed(monkeypatch):
    monkeypatch.setattr(SequenceTask, "progress", None)
    world = NodesWorld()
    outcome, state = world.step(torch.zeros(4), world.initial())
    assert list(outcome.observation) == list(world.observe(state)) == ["match"]
    with pytest.raises(TypeError):
        NodesWorld(senses=("lamp",)).observe(state)


def test_a_snapshot_goes_on_bit_by_bit():
    task = SequenceTask("GBG", then=("RYR", 60))
    world = NodesWorld(task, **FAST, senses=("match", "lamp"), feasible=table(after_0=(1,)))
    _, _, state = seek(world, world.initial((2,)), [1, 0], [2, 3], steps=24, rest=4)
    saved = world.snapshot(state)
    expected, _, _ = seek(world, state, [1, 0], [0, 2], [3, 1])
    restored = world.restore(saved, world.initial((2,)))
    assert restored.task.age.tolist() == [56, 56]
    assert torch.equal(seek(world, restored, [1, 0], [0, 2], [3, 1])[0], expected)
    assert world.again(world.initial((2,)), restored).task.age.tolist() == [0, 0]


@pytest.mark.skipif(not shutil.which("g++"), reason="needs a C++ compiler")
@pytest.mark.parametrize("tables", ["one", "each"])
def test_compiled_as_eager(tables):
    torch.compiler.reset()
    feasible = table(after_2=(1,), after_1=(1, 3))
    feasible = torch.stack([feasible, feasible.T, table()]) if tables == "each" else feasible
    task = SequenceTask("GBG", others=("RYR",), then=("BYB", 90))
    world = NodesWorld(task, **FAST, senses=("match", "lamp"), feasible=feasible)
    compiled = torch.compile(world.step, fullgraph=True, dynamic=False)
    state = other = world.initial((3,))
    orders, lamps = torch.tensor([[1, 2, 1, 0, 3], [2, 1, 2, 3, 2], [0, 3, 0, 2, 3]]), 0.0
    for k in range(5 * 30):
        on = torch.nn.functional.one_hot(orders[:, k // 30], 4).float()
        expected, state = world.step(on, state)
        got, other = compiled(on, other)
        torch.testing.assert_close((got, other), (expected, state), rtol=0, atol=1e-6)
        lamps += float(expected.observation["lamp"].sum())
    assert lamps > 1 and state.task.recent.ne(NOTHING).any()


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"senses": ("image",)}, ["senses=('image',)", "('match', 'lamp')"]),
        ({"senses": "lamp"}, ["senses='lamp'"]),
        ({"senses": None}, ["senses=None"]),
        ({"feasible": torch.ones(4, 4)}, ["feasible=[4, 4]", "bool"]),
        ({"feasible": torch.ones(3, 3, dtype=torch.bool)}, ["feasible=[3, 3]", "[4, 4]"]),
        ({"feasible": torch.ones((), dtype=torch.bool)}, ["feasible=[]", "[4, 4]"]),
        ({"feasible": True}, ["feasible=True", "[4, 4]"]),
    ],
)
def test_bad_arguments_are_named_with_a_remedy(arguments, words):
    with pytest.raises(ValueError, match="give") as error:
        NodesWorld(**arguments)
    assert all(word in str(error.value) for word in words)

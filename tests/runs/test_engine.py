"""One engine: alone, in a batch, compiled and resumed it is the same run."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils import _pytree as pytree

from dntorch.modules.sarsa import DNSarsa
from dntorch.process import can_compile
from dntorch.runs.compiling import Compiled
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.run import Run, Trial
from dntorch.runs.worlds import WORLDS

needs_compiler = pytest.mark.skipif(not can_compile(), reason="needs a C++ compiler")
SMALL = {"width": 20, "height": 9}
every_batched_world = pytest.mark.parametrize(
    "world", [name for name, row in WORLDS.items() if row.batched]
)


def group(world: str, count: int, steps: int = 700, **others) -> Group:
    config = Config(world=world, steps=steps, explore=500, seed=5, **SMALL, **others)
    numbers = tuple(range(count))
    if WORLDS[world].numbered:
        return Group(config, agents=numbers)
    return Group(config, seeds=tuple(5 + k for k in numbers), rows=numbers)


@every_batched_world
def test_alone_and_in_a_batch_of_a_world_the_decisions_are_the_same(world: str) -> None:
    together = Run(group(world, 3))
    together.advance(700)
    assert (together.agent.decisions >= 2).all()
    alone = Trial(group(world, 1).member(0))
    alone.advance(700)
    mine = together.record.member(0)
    np.testing.assert_array_equal(mine.found, alone.record.found)
    np.testing.assert_array_equal(mine.reported, alone.record.reported)
    np.testing.assert_allclose(mine.intention, alone.record.intention, atol=1e-5)


@needs_compiler
@every_batched_world
def test_a_compiled_run_decides_as_the_eager_one_and_resumes_bit_by_bit(world, tmp_path) -> None:
    eager, whole = Run(group(world, 4), True), Run(group(world, 4), True, compiled=True)
    whole.advance(390)
    whole.save(tmp_path / "c.pt")
    whole.advance(310)
    eager.advance(700)
    np.testing.assert_array_equal(whole.memory.joined()["onset"], eager.memory.joined()["onset"])
    np.testing.assert_array_equal(whole.memory.joined()["find"], eager.memory.joined()["find"])
    second = Run(group(world, 4), True, compiled=True).restore(tmp_path / "c.pt")
    second.advance(700)
    for name, array in second.memory.joined().items():
        np.testing.assert_array_equal(array, whole.memory.joined()[name], err_msg=name)


@needs_compiler
def test_running_freely_for_2000_steps_all_ways_decide_the_same() -> None:
    def onsets(**options) -> list[np.ndarray]:
        run = Run(group("nodes", 256, 2000), events=True, **options)
        run.advance(2000)
        onset = run.memory.joined()["onset"]
        return [onset[onset[:, 0] == k, 2] for k in range(256)]

    ways = [onsets(), onsets(compiled=True), onsets(dtype=torch.float64)]
    assert min(map(len, ways[0])) > 3
    for other in ways[1:]:
        same = [np.array_equal(a, b) for a, b in zip(ways[0], other)]
        assert sum(same) >= 255, np.flatnonzero(np.logical_not(same))


@needs_compiler
def test_a_compiled_step_keeps_one_entry_and_its_addresses() -> None:
    torch.compiler.reset()
    torch._dynamo.utils.counters.clear()
    run = Run(group("nodes", 4), True, compiled=True)
    places = []
    for _ in range(3):
        run.advance(200)
        moments = run.engine.moment, run.engine._step.target
        places.append({leaf.data_ptr() for leaf in pytree.tree_leaves(moments)})
    assert torch._dynamo.utils.counters["stats"]["unique_graphs"] == 1
    assert places[0] == places[1] == places[2]
    assert run.engine.compiling > 0


@needs_compiler
def test_an_agent_is_compiled_in_front_of_a_world_that_is_not(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    torch.compiler.reset()
    torch._dynamo.utils.counters.clear()
    config = Config(world="epuck", seed=3, steps=400, explore=300, **SMALL)
    eager, compiled = Trial(config), Trial(config, compiled=True)
    for trial in (eager, compiled):
        trial.advance(170)
    compiled.save(tmp_path / "c.pt")
    resumed = Trial.load(tmp_path / "c.pt")
    assert resumed.compiled
    for trial in (eager, compiled, resumed):
        trial.advance(400)
        trial.close()
    assert torch._dynamo.utils.counters["stats"]["unique_graphs"] == 1
    np.testing.assert_array_equal(compiled.record.found, eager.record.found)
    np.testing.assert_allclose(compiled.record.intention, eager.record.intention, atol=1e-3)
    for name, array in compiled.record.arrays().items():
        np.testing.assert_array_equal(resumed.record.arrays()[name], array, err_msg=name)


@needs_compiler
def test_a_parameter_that_is_set_between_two_portions_counts_in_a_compiled_run() -> None:
    eager, compiled = Run(group("nodes", 4), True), Run(group("nodes", 4), True, compiled=True)
    for run in (eager, compiled):
        run.advance(100)
        run.agent.value_nodes.tau = 0.4
        run.advance(200)
    torch.testing.assert_close(compiled.agent.state, eager.agent.state, atol=1e-4, rtol=1e-4)
    plain = Run(group("nodes", 4), True)
    plain.advance(300)
    assert (plain.agent.state.value_nodes.value - eager.agent.state.value_nodes.value).any()


def test_a_world_for_one_agent_refuses_a_batch() -> None:
    with pytest.raises(ValueError, match="batch=2: only worlds of pure tensors run as a batch"):
        Run(group("epuck", 2))


def test_many_events_in_a_short_time_are_all_kept() -> None:
    """Nodes that are on at rest can flicker: more decisions than a table of chance holds."""
    from dntorch.paper.populations import Population

    class Flickering(Population):
        def build_agent(self) -> DNSarsa:
            agent = super().build_agent()
            agent.behaviors.value_gain, agent.behaviors.completion_gain = 60.0, 120.0
            agent.behaviors.intention.floor = None
            return agent

    config = Config(world="nodes", steps=1200, explore=1200, seed=1)
    run = Run(Flickering(config, (0, 1, 2, 3), variant="printed_rest"), True)
    run.advance(1200)
    onsets = np.bincount(run.memory.joined()["onset"][:, 0], minlength=4)
    assert onsets.tolist() == run.agent.decisions.tolist() and onsets.max() > 300
    alone = Run(Flickering(config, variant="printed_rest"), True)
    alone.advance(300)
    assert alone.agent.decisions == (alone.memory.joined()["onset"][:, 1] < 300).sum() > 90


def no_cache(*_, **__):
    raise FileNotFoundError(2, "No such file or directory", "/proc/no")


def no_compiler(*_, **__):
    raise RuntimeError("No working C++ compiler found")


BROKEN = {"cache": no_cache, "compiler": partial(torch.compile, backend=no_compiler)}


@pytest.mark.parametrize("broken", BROKEN)
@pytest.mark.parametrize("world", ["nodes", "epuck"])
def test_where_compiling_fails_the_run_goes_on_without(
    broken: str, world: str, tmp_path: Path, monkeypatch
) -> None:
    if world == "epuck":
        pytest.importorskip("pybullet")
    torch.compiler.reset()
    config = Config(world=world, steps=60, explore=30, noise=9.5, **SMALL)
    eager, compiled = Trial(config), Trial(config, compiled=True)
    eager.advance(60)
    with monkeypatch.context() as patched, pytest.warns(UserWarning, match="could not be compiled"):
        patched.setattr(torch, "compile", BROKEN[broken])
        compiled.advance(30)
        assert not compiled.compiled
        compiled.save(tmp_path / "c.pt")  # as what it is: what resumes it takes the same steps
        compiled.advance(60)
    resumed = Trial.load(tmp_path / "c.pt")
    resumed.advance(60)
    for name, array in eager.record.arrays().items():
        np.testing.assert_array_equal(compiled.record.arrays()[name], array, err_msg=name)
        np.testing.assert_array_equal(resumed.record.arrays()[name], array, err_msg=name)
    for run in (eager, compiled, resumed):
        run.close()


def test_a_cache_that_cannot_be_written_to_leaves_no_half_of_the_compiler() -> None:
    program = (
        "from dntorch.runs.config import Config\n"
        "from dntorch.runs.run import Trial\n"
        "run = Trial(Config(world='nodes', steps=9, explore=5), compiled=True)\n"
        "run.advance(9)\n"
        "print(run.step, run.compiled)\n"
    )
    command = [sys.executable, "-c", program]
    environment = os.environ | {
        "TORCHINDUCTOR_CACHE_DIR": "/dev/null/none",
        "PYTHONWARNINGS": "default",
    }
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.stdout == "9 False\n", done.stderr
    assert "could not be compiled" in done.stderr


@pytest.mark.skipif(not can_compile(), reason="needs a C++ compiler")
def test_a_process_may_compile_more_engines_than_the_compiler_keeps_entries() -> None:
    with torch._dynamo.config.patch(recompile_limit=1):
        for size in (1, 2):
            one = torch.ones(size)

            def twice(x: torch.Tensor, y: torch.Tensor = one) -> torch.Tensor:
                return x + y

            assert torch.equal(Compiled(twice)(one), 2 * one)

"""Populations equal single runs; what `reproduce` writes, and how it goes on."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from dntorch.commands.reproduce import reproduce as command
from dntorch.envs.nodes import NodesWorld
from dntorch.envs.task import SequenceTask
from dntorch.files import plain
from dntorch.noise import Exploration
from dntorch.paper.claims import claims
from dntorch.paper.figures import draw
from dntorch.paper.page import write_page
from dntorch.paper.populations import Population
from dntorch.paper.reproduce import reproduce
from dntorch.paper.variants import VARIANTS
from dntorch.paper.verdict import NO, UNTESTABLE, YES
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job, run_groups
from dntorch.runs.run import Run, Trial

SHORT = Config(world="nodes", steps=2000, explore=1400, seed=11)


def events(group: Group, dtype: torch.dtype = torch.float32, portions: int = 1, **options) -> dict:
    run = Run(group, True, dtype, **options)
    for _ in range(portions):
        run.advance(group.config.steps // portions)
    return run.memory.joined()


def decisions(result: dict, agent: int) -> list[list[int]]:
    """Step and colour of every completed behaviour."""
    return result["onset"][result["onset"][:, 0] == agent][:, 1:].tolist()


def alone(config: Config, agent: int, dtype: torch.dtype) -> list[list[int]]:
    """The same from the library's own agent and world, without any batch."""
    actor = build_agent(config).to(dtype)
    world = NodesWorld(SequenceTask())
    noise = Exploration(4, config.seed, agent)
    seen, state, world_state = [], actor.state, world.initial((), config.seed, agent)
    observation = {"match": torch.zeros(4, dtype=dtype)}
    reward = torch.zeros((), dtype=dtype)
    was = torch.zeros(4, dtype=torch.bool)
    with torch.inference_mode():
        for step in range(config.steps):
            drawn = noise(state.decisions, dtype) * (step < config.explore)
            action, state = actor.step(observation, reward, drawn, state)
            outcome, world_state = world.step(action, world_state)
            observation, reward = outcome.observation, outcome.reward.to(dtype)
            on = actor.behaviors.output(state.behaviors)[1] > 0.5
            if (on & ~was).any():
                seen.append([step, int((on & ~was).int().argmax())])
            was = on
    return seen


@pytest.fixture(scope="module")
def thousand() -> dict:
    """A batch of 1,000 in float32 and float64."""
    group = Group(SHORT, tuple(range(1000)))
    return {dtype: events(group, dtype) for dtype in (torch.float32, torch.float64)}


def test_alone_and_in_a_batch_of_a_thousand_the_decisions_are_the_same(thousand: dict) -> None:
    for agent in (3, 997):
        wanted = alone(SHORT, agent, torch.float32)
        assert len(wanted) > 8
        assert wanted == alone(SHORT, agent, torch.float64)
        for result in thousand.values():
            assert decisions(result, agent) == wanted


def test_float32_and_float64_decide_alike_in_all_of_a_thousand(thousand: dict) -> None:
    single, double = thousand.values()
    np.testing.assert_array_equal(single["onset"], double["onset"])
    np.testing.assert_array_equal(single["find"], double["find"])


def test_agent_zero_is_the_trial_of_this_seed(thousand: dict) -> None:
    trial = Trial(SHORT)
    trial.advance(SHORT.steps)
    steps = np.flatnonzero(trial.record.reported >= 0)
    wanted = np.stack((steps, trial.record.reported[steps]), 1).tolist()
    assert decisions(thousand[torch.float32], 0) == wanted
    end = thousand[torch.float32]["weights_end"][0]
    np.testing.assert_allclose(end, trial.agent.weights, atol=1e-5)


def test_a_split_into_batches_changes_nothing(thousand: dict) -> None:
    part = events(Group(SHORT, (999, 5, 640)))
    for agent in (5, 640, 999):
        assert decisions(part, agent) == decisions(thousand[torch.float32], agent)


def test_the_compiled_step_decides_like_the_plain_one(thousand: dict) -> None:
    part = events(Group(SHORT, tuple(range(40))), compiled=True)
    for agent in range(40):
        assert decisions(part, agent) == decisions(thousand[torch.float32], agent)


def test_portions_and_a_resume_give_the_same_numbers(tmp_path) -> None:
    group = Group(SHORT, tuple(range(6)))
    whole, first = events(group), Run(group, True)
    first.advance(770)
    first.save(tmp_path / "p.pt")
    second = Run(group, True).restore(tmp_path / "p.pt")
    second.advance(5000)
    for name, array in second.memory.joined().items():
        np.testing.assert_array_equal(array, whole[name])
    for other in (Group(SHORT, (0, 1)), Population(SHORT, group.agents, variant="short_trace")):
        with pytest.raises(ValueError, match="another group"):
            Run(other, True).restore(tmp_path / "p.pt")


def test_parameters_may_differ_between_agents() -> None:
    rates, taus = (0.03, 0.12), (1.0, 2.0)
    config = Config(world="nodes", steps=1300, explore=1300, seed=2, sequence="GB")
    many = {"learner.values.learning_rate": rates, "learner.trace.tau": taus}
    together = events(Population(config, (0, 0), parameters=many, shown=3, rows=(0, 1)))
    for k, (rate, tau) in enumerate(zip(rates, taus)):
        one = replace(config, learning_rate=rate, trace_tau=tau)
        single = events(Population(one, (0,), shown=3))
        assert abs(single["weights_end"]).max() > 0
        np.testing.assert_allclose(together["weights_end"][k], single["weights_end"][0], atol=1e-6)
        assert decisions(together, k) == decisions(single, 0)


def test_exploration_can_be_led_through_the_sequence() -> None:
    config = Config(world="nodes", steps=2000, explore=2000, seed=4)
    unled, led = (
        events(Population(config, tuple(range(12)), shown=k))["find"][:, 3] for k in (0, 1)
    )
    assert unled.sum() < 3 < led.sum()


def test_several_sequences_are_rewarded() -> None:
    config = Config(world="nodes", steps=800, explore=800, seed=4, sequence="RG")
    one = events(Group(config, tuple(range(20))))["find"][:, 3].sum()
    two = events(Population(config, tuple(range(20)), tasks=("BY", "YB")))["find"][:, 3].sum()
    assert two > one > 0
    with pytest.raises(ValueError, match="as long as"):
        Run(Population(config, (0,), tasks=("RGB",)), True)


def test_learning_can_end_with_exploration() -> None:
    config = Config(world="nodes", steps=1600, explore=1300, seed=2, sequence="GB")
    result = events(Population(config, (0,), shown=3, learns_in_exploitation=False))
    np.testing.assert_array_equal(result["weights_explored"], result["weights_end"])
    assert abs(result["weights_end"]).max() > 0


BRIEF = Config(world="nodes", steps=1200, explore=1200, seed=2, sequence="GB")


@pytest.fixture(scope="module")
def unchanged() -> dict:
    return events(Group(BRIEF, (0, 1, 2, 3)))


@pytest.mark.parametrize("variant", sorted(set(VARIANTS) - {""}))
def test_every_variant_runs_and_differs(variant: str, unchanged: dict) -> None:
    changed = events(Population(BRIEF, (0, 1, 2, 3), variant=variant))
    same = {k: np.array_equal(unchanged[k], changed[k], equal_nan=True) for k in unchanged}
    assert not (same["weights_end"] and same["onset"])


def test_unknown_variant() -> None:
    with pytest.raises(ValueError, match="variant='x' is unknown: choose from"):
        Run(Population(SHORT, (0,), variant="x"), True)


TINY = Config(world="nodes", steps=900, explore=600, seed=2, sequence="GB")
LEARNERS = ("neural", "sarsa", "td0", "neural_single_item")


@pytest.fixture
def no_compiler(monkeypatch) -> None:
    """Worker processes take plain steps: for a few hundred, compiling takes longer."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)


def test_reproduce_writes_what_it_promises(no_compiler, tmp_path) -> None:
    whole = reproduce(TINY, 4, tmp_path / "whole", processes=2).results
    results = json.loads((tmp_path / "whole" / "results.json").read_text())
    assert results["runs"] == 4 and results["seed"] == 2 and results["world"] == "nodes"
    assert results["dt"] == 1 / 32 and len(results["behaviors_in_exploration"]) == 2
    for name in LEARNERS:
        for key in ("found", "optimal_given_found", "optimal_given_not_found"):
            k, n = results[name][key]
            assert 0 <= k <= n <= 4
        assert {"median", "quartiles"} <= results[name]["behaviors_to_optimal"].keys()
    law = {"r2", "next_coefficient", "old_coefficient", "reward_coefficient", "transitions"}
    assert law <= results["update_regression"].keys()
    assert np.shape(results["transition_counts"]) == (4, 4, 4)
    assert "yoked_correlation" in results
    # A part that is missing is made again, to the same numbers.
    (tmp_path / "whole" / "parts" / "single-1.npz").unlink()
    again = reproduce(TINY, 4, tmp_path / "whole", processes=2).results
    different = {"duration_seconds", "commit"}
    assert {k: plain(v) for k, v in again.items() if k not in different} == {
        k: plain(v) for k, v in whole.items() if k not in different
    }


def test_the_page_has_a_verdict_for_every_claim(no_compiler, tmp_path) -> None:
    study = reproduce(TINY, 2, tmp_path, processes=1)
    page = write_page(study, draw(study, tmp_path), tmp_path, "dntorch reproduce").read_text()
    made = claims(study)
    assert len(made) > 15 and {c.verdict for c in made} <= {YES, NO, UNTESTABLE}
    assert page.count("<tr><td>") == len(made) and (tmp_path / "results.png").exists()


CAMERA = "--world epuck --runs 2 --steps 400 --explore 350 --seed 12 --processes 1".split()


STOPS_AT_THE_FIRST_STEPS = """
import signal, sys
import tqdm
def update(bar, steps=1):
    if steps > 0 and not bar.n:
        bar.n = steps
        signal.raise_signal(signal.SIGINT)
tqdm.tqdm.update = update
from dntorch.cli import main
main()
"""


@pytest.fixture(scope="module")
def camera(tmp_path_factory) -> Path:
    """A folder of finished runs in PyBullet."""
    pytest.importorskip("pybullet")
    folder = tmp_path_factory.mktemp("camera") / "whole"
    done = CliRunner().invoke(command, [*CAMERA, "--out", str(folder)])
    assert done.exit_code == 0, (done.output, done.exception)
    assert "report:" in done.output
    return folder


def test_camera_runs_are_the_trials_of_their_seeds(camera: Path) -> None:
    results = json.loads((camera / "results.json").read_text())
    assert results["world"] == "epuck" and results["neural"]["found"][1] == 2
    trial = Trial(Config(world="epuck", seed=13, steps=400, explore=350))
    trial.advance(400)
    events = np.load(camera / "parts" / "neural-1.npz")
    steps = np.flatnonzero(trial.record.reported >= 0)
    assert len(steps) > 2
    np.testing.assert_array_equal(events["onset"][:, 1], steps)
    np.testing.assert_array_equal(events["weights_end"], trial.agent.weights)
    trial.close()
    assert (camera / "dynamics.png").exists() or results["neural"]["found"][0] == 0


def test_camera_runs_go_on_after_ctrl_c(camera: Path, tmp_path: Path) -> None:
    command_line = ["reproduce", *CAMERA, "--out", str(tmp_path / "stopped")]
    done = subprocess.run(
        [sys.executable, "-c", STOPS_AT_THE_FIRST_STEPS, *command_line],
        capture_output=True, text=True, timeout=400,
    )  # fmt: skip
    assert "go on with: dntorch reproduce --resume" in done.stderr
    assert done.returncode == 130
    assert not (tmp_path / "stopped" / "results.json").exists()
    done = CliRunner().invoke(command, ["--resume", str(tmp_path / "stopped")])
    assert done.exit_code == 0, (done.output, done.exception)
    stopped, whole = (
        json.loads((folder / "results.json").read_text()) | {"duration_seconds": 0}
        for folder in (tmp_path / "stopped", camera)
    )
    assert stopped == whole


def test_runs_of_another_group_are_not_taken_for_these(no_compiler, tmp_path: Path) -> None:
    here = [Job("same", Group(TINY, (0, 1)))]
    first = run_groups(here, tmp_path, processes=1)["same"]
    for other in (
        Population(TINY, (0, 1), variant="short_trace"),
        Group(replace(TINY, seed=9), (0, 1)),
    ):
        with pytest.raises(ValueError, match="another group of runs: name another folder"):
            run_groups([Job("same", other)], tmp_path, processes=1)
    for name, array in run_groups(here, tmp_path, processes=1)["same"].items():
        np.testing.assert_array_equal(array, first[name])

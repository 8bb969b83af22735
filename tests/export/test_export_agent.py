"""Any agent in any world becomes artefacts; a run is not needed."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
from needs import needs
from structures import beyond
from torch import Tensor

from dntorch import DNSarsa, Exploration
from dntorch.envs import NodesWorld, SequenceTask
from dntorch.export import export_agent, replay
from dntorch.export.artefacts import DEFAULT
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.export import export_run
from dntorch.runs.run import Trial

N, STEPS = 2, 800


class Respond:
    """The abstract world as a function."""

    def __init__(self) -> None:
        self.world = NodesWorld(SequenceTask("GB", "GB"))
        self.state = self.world.initial()

    def __call__(self, action: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        if action is None:
            return {"match": torch.zeros(N)}, torch.zeros(())
        outcome, self.state = self.world.step(action, self.state)
        return outcome.observation, outcome.reward


@pytest.fixture
def agent() -> DNSarsa:
    agent = DNSarsa(N)
    agent.weights.copy_(torch.tensor([[0.0, 0.5], [0.4, 0.0]]))
    for _ in range(20):  # somewhere, not at rest
        agent({"match": torch.zeros(N)}, torch.tensor(0.0), torch.zeros(N))
    return agent


def test_an_agent_is_exported_at_rest_with_what_it_learned(agent, tmp_path: Path, capsys) -> None:
    before = agent.snapshot()
    about = {"source": "a kitchen table"}
    noise = Exploration(N, 7, amplitude=3.0)
    export_agent(agent, Respond(), tmp_path, exploration=noise, steps=STEPS, about=about)
    assert replay.verify(tmp_path), capsys.readouterr().out
    manifest, golden = replay.read(tmp_path)
    assert manifest["source"] == "a kitchen table"
    assert manifest["exploration"] == {"amplitude": 3.0, "seed": 7}
    assert "max_speed" not in manifest  # nothing that drives
    assert golden["run/match"].shape == (STEPS, N) and golden["run/next.decisions"][-1] >= 2
    assert (golden["run/reward"] > 0).any() and (golden["run/noise"] > 1).any()
    assert (golden["start/behaviors.intention.u"] == -5).all()
    assert (golden["start/learner.values.weights"][0] == agent.weights.numpy()).all()
    assert all(torch.equal(value, before[name]) for name, value in agent.snapshot().items())


class Whole(NamedTuple):
    folder: Path
    config: Config


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Whole:
    """A run whose agent has every part; what is second for it depends on the lamp."""
    folder = tmp_path_factory.mktemp("run")
    config = Config(
        world="nodes", steps=40, explore=40, sequence="YRGBY", then="GBYRG", change=20, seed=1,
        **AUTONOMOUS | {"patience": 4.0, "recall": 1, "constraints": 20.0, "curiosity": 4.0},
    )  # fmt: skip
    trial = Trial(config)
    values = trial.agent.deliberation.curiosity.weights
    values[config.colors.index("G"), 0] = 5.0
    values[config.colors.index("R"), 0] = 4.0
    values[config.colors.index("B"), 2:4] = 4.0  # while the lamp is at a half
    trial.save(folder / "checkpoint.pt")
    return Whole(folder, config)


def test_a_run_with_every_part_is_exported_with_a_record_of_each(whole, tmp_path, capsys) -> None:
    export_run(whole.folder, tmp_path, ["torchscript"])
    assert replay.verify(tmp_path), capsys.readouterr().out
    manifest, golden = replay.read(tmp_path)
    assert {port["name"] for port in manifest["inputs"]} == {"match", "lamp", "reward", "noise"}
    lasting = {port["name"] for port in manifest["state"] if port["lasting"]}
    assert lasting >= {"deliberation.constraints.suppression", "deliberation.curiosity.weights"}
    assert golden["run/next.failures"][-1] >= 1 and np.nanmax(golden["run/reward"]) > 0
    assert {0.0, 0.5, 1.0} == set(golden["run/lamp"].ravel().tolist())
    for part in (
        "recall.u",
        "habituation.recall.u",
        "constraints.suppression",
        "curiosity.weights",
    ):
        values = golden[f"run/next.deliberation.{part}"]
        assert not np.array_equal(values[0], values[-1]), part
    spent = golden["pairs/next.deliberation.habituation.spent"]
    assert spent[golden["pairs/step"] >= 0].max() > 0.5


@needs("onnx", "onnxscript", "onnxruntime")
def test_an_agent_with_every_part_goes_to_onnx_and_torch_export(tmp_path, capsys) -> None:
    seen = {"match": torch.zeros(3), "lamp": torch.tensor([0.5])}, torch.tensor(1.0)
    export_agent(beyond(), lambda action: seen, tmp_path, DEFAULT, steps=60)
    assert replay.verify(tmp_path), capsys.readouterr().out
    assert {"agent.ts", "agent.pt2", "agent.onnx"} <= {path.name for path in tmp_path.iterdir()}


def test_without_exploration_there_is_no_noise_and_none_is_promised(agent, tmp_path) -> None:
    export_agent(agent, Respond(), tmp_path, ["torchscript"], steps=40)
    manifest, golden = replay.read(tmp_path)
    assert "exploration" not in manifest and not (golden["run/noise"] > 0).any()


def test_a_batch_of_agents_is_refused(tmp_path) -> None:
    with pytest.raises(ValueError, match=r"agent is a batch of shape \[3\]: .*agent.select"):
        export_agent(DNSarsa(N).spread(3), Respond(), tmp_path)

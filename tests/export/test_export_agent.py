"""Any agent in any world becomes artefacts; a run is not needed."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from dntorch import DNSarsa, Exploration
from dntorch.envs import NodesWorld, SequenceTask
from dntorch.export import export_agent, replay

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


def test_without_exploration_there_is_no_noise_and_none_is_promised(agent, tmp_path) -> None:
    export_agent(agent, Respond(), tmp_path, ["torchscript"], steps=40)
    manifest, golden = replay.read(tmp_path)
    assert "exploration" not in manifest and not (golden["run/noise"] > 0).any()


def test_a_batch_of_agents_is_refused(tmp_path) -> None:
    with pytest.raises(ValueError, match=r"agent is a batch of shape \[3\]: .*agent.select"):
        export_agent(DNSarsa(N).spread(3), Respond(), tmp_path)

"""ExecuTorch, on request: `pip install 'dntorch[executorch]'`, 200 MB that no other test needs."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

pytest.importorskip("executorch")

import dntorch
from dntorch.export import export_structure, replay

# ExecuTorch and what it imports warn of their own and each other's parts.
pytestmark = pytest.mark.filterwarnings("ignore")


def rows(n: int, steps: int = 60) -> list[tuple[dict[str, Tensor], Tensor, Tensor]]:
    generator = torch.Generator().manual_seed(0)

    def unit(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator)

    rows = [({"match": unit(n)}, unit(), unit(n)) for _ in range(steps)]
    rows[10] = (rows[10][0], torch.tensor(torch.nan), rows[10][2])
    return rows


def test_the_agent_runs_in_executorch_and_keeps_what_it_knows(tmp_path: Path, capsys) -> None:
    agent = dntorch.DNSarsa(3)
    agent.weights.fill_(0.25)
    export_structure(agent, tmp_path, rows(3), ["executorch"], "agent")
    assert replay.verify(tmp_path), capsys.readouterr().out
    manifest, _ = replay.read(tmp_path)
    held = replay.LOADERS["executorch"](tmp_path / "agent.pte", manifest).state()
    assert (held["learner.values.weights"] == 0.25).all()
    assert (held["behaviors.intention.u"] == -5).all()

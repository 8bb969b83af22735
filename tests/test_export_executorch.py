"""ExecuTorch, on request: `pip install 'dntorch[executorch]'`, 200 MB that no other test needs."""

from pathlib import Path

import pytest
import torch

pytest.importorskip("executorch")

import dntorch
from dntorch.export import export_structure, replay

# ExecuTorch and what it imports warn of their own and each other's parts.
pytestmark = pytest.mark.filterwarnings("ignore")


def rows(n: int, steps: int = 60) -> list[tuple[torch.Tensor, ...]]:
    generator = torch.Generator().manual_seed(0)
    shapes = [(n,), (), (n, n)]
    return [tuple(torch.rand(s, generator=generator) for s in shapes) for _ in range(steps)]


def test_the_agent_runs_in_executorch_and_keeps_what_it_knows(tmp_path: Path, capsys) -> None:
    agent = dntorch.DNSarsa(3)
    agent.weights.fill_(0.25)
    export_structure(agent, tmp_path, rows(3), ["executorch"], "agent")
    assert replay.verify(tmp_path), capsys.readouterr().out
    manifest, _ = replay.read(tmp_path)
    held = replay.RUNTIMES["executorch"](tmp_path / "agent.pte", manifest).state()
    assert (held["learner.values.weights"] == 0.25).all()
    assert (held["behaviors.intention.u"] == -5).all()

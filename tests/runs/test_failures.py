"""An agent that gives up what is in vain is not stuck where a colour is nowhere."""

from dataclasses import replace

import numpy as np
import pytest
from needs import EPUCK

from dntorch.colors import PAPER
from dntorch.runs.config import AUTONOMOUS, Config
from dntorch.runs.run import Trial

BLUE, PATIENCE = PAPER.index("B"), 6.0


@pytest.mark.parametrize("world", ["ring", EPUCK])
def test_where_a_colour_is_missing_an_agent_gives_it_up_and_goes_on(world: str) -> None:
    """With this seed the first intention of both is the colour that is missing."""
    numbers = AUTONOMOUS | {"patience": PATIENCE}
    config = Config(
        world=world, missing="B", sequence="GYRG", seed=1, steps=1000, explore=1000, **numbers
    )
    patient, vain = Trial(config), Trial(replace(config, patience=0.0, constraints=0.0))
    for trial in (patient, vain):
        trial.advance(1000)
        trial.close()
    wanted, _ = (trial.record.intention[:, BLUE] > 0.5 for trial in (patient, vain))
    begun = int(wanted.argmax())
    assert vain.record.intention[begun:, BLUE].min() > 0.5
    assert len(vain.record.behaviors) == 0 and vain.agent.failures == 0
    after = patient.record.found[begun + round(PATIENCE / config.dt) :]
    assert wanted[begun] and (after >= 0).sum() >= 3 and BLUE not in after
    assert patient.agent.failures >= 1
    assert longest(wanted) == pytest.approx(PATIENCE / config.dt, abs=16)


def longest(true: np.ndarray) -> int:
    """Steps of the longest run of true values."""
    edges = np.flatnonzero(np.diff(true.astype(int), prepend=0, append=0))
    return int((edges[1::2] - edges[::2]).max(initial=0))

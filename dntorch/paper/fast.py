"""The agents at a rate at which learning takes time: what lies between the find and the optimum.

At the default rate one find is enough and nothing lies between, so that nothing can be compared.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from dntorch.paper import statistics as st
from dntorch.paper.comparison import discrete_success, reference, theory_of
from dntorch.paper.law import transition_counts
from dntorch.paper.predictions import predictions
from dntorch.paper.runs import Runs
from dntorch.paper.study import shortcuts
from dntorch.paper.success import Success, describe, neural_success
from dntorch.runs.config import Config

RATE = 0.2
"""1/s, of the values."""


def at_the_rate(config: Config) -> Config:
    return replace(config, learning_rate=RATE)


def between(runs: Success) -> np.ndarray:
    """Behaviours from the find to the optimum, of the runs that came to it."""
    good = runs.found & runs.optimal & (runs.needed > 0)
    return (runs.needed - runs.first - 1)[good]


def measure_fast(runs: Runs, config: Config) -> dict[str, Any]:
    """What became of the runs of `at_the_rate`, beside discrete learners that explore alike."""
    config = at_the_rate(config)
    result, explored, total = neural_success(runs, config)
    counts = transition_counts(runs, config.explore, len(config.colors))
    learning = reference(theory_of(config))
    other = discrete_success(config, learning, explored, total, counts)["sarsa_matched"]
    margin = predictions("main")["fast"]["from_find_to_optimal_margin"]
    return {
        "learning_rate": RATE,
        "neural": describe(result),
        "sarsa_matched": describe(other),
        "shortcuts": shortcuts(config, runs, result, explored),
        "from_find_to_optimal": st.equivalent_means(between(result), between(other), margin),
    }

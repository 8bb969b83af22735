"""The neural runs beside discrete SARSA(lambda): what it would have done, tests of equality."""

from dataclasses import replace
from typing import Any

import numpy as np

from dntorch.cells.functions import is_on
from dntorch.colors import indices
from dntorch.paper import discrete
from dntorch.paper import statistics as st
from dntorch.paper.law import correlation
from dntorch.paper.predictions import predictions
from dntorch.paper.runs import Runs
from dntorch.paper.success import Success, needed_rewards, proportion, success
from dntorch.paper.theory import Theory, theory
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.record import LOOK_BACK
from dntorch.runs.run import Trial


def theory_of(config: Config) -> Theory:
    """Learning rates and lambda that theory expects of the agent of a config."""
    learner = build_agent(config).learner
    return theory(learner, hand_over(config), config.reward, config.reward_duration)


def reference(expected: Theory) -> discrete.Learning:
    """Discrete SARSA(lambda) as theory says that the neural learner performs it."""
    return discrete.Learning(expected.old, min(expected.trace_decay, 1.0), expected.discount)


def hand_over(config: Config, steps: int = 3000) -> float:
    """Seconds from the end of a pair to the begin of the next, in one short exploration."""
    trial = Trial(replace(config, world="nodes", steps=steps, explore=steps))
    trial.advance(steps)
    record = trial.record
    running, completed = is_on(record.intention), is_on(record.satisfaction)
    active = running.any(1) & completed.any(1)
    active &= ~(running & completed).any(1)  # the pair (i, i) does not exist
    edges = np.flatnonzero(np.diff(active.astype(int)))
    gaps = np.diff(edges)[~active[edges[:-1] + 1]]
    return float(np.median(gaps)) * config.dt if len(gaps) else 0.5


def discrete_success(
    config: Config,
    learning: discrete.Learning,
    explored: np.ndarray,
    total: np.ndarray,
    counts: np.ndarray,
) -> dict[str, Success]:
    """Discrete learners with the same number of behaviours as each neural run.

    They explore uniformly, or ("matched") as often from each pair to the next behaviour as
    the neural runs did, ``counts``.
    """
    kinds = {
        "sarsa": learning,
        "sarsa_replacing": replace(learning, replacing=True),
        "td0": replace(learning, trace_decay=0.0),
    }
    table = {}
    for suffix, chances in (("", None), ("_matched", counts)):
        for name, kind in kinds.items():
            history = discrete.explore_or_exploit(
                kind, explored, total, config.seed, config.sequence, config.colors, chances=chances
            )
            table[name + suffix] = success(
                history.rewarded, history.policy, explored, total, needed_rewards(config)
            )
    return table


def equivalence(neural: Success, learners: dict[str, Success]) -> dict[str, Any]:
    """Two one-sided tests of the neural against each discrete learner with traces."""
    margins = predictions("main")["equivalence"]
    table = {}
    for name in ("sarsa_matched", "sarsa_replacing_matched", "sarsa", "sarsa_replacing"):
        other = learners[name]
        k = [(int(o.optimal[o.found].sum()), int(o.found.sum())) for o in (neural, other)]
        late = [(int(o.late[o.found].sum()), int(o.found.sum())) for o in (neural, other)]
        needed = [o.needed[o.found & o.optimal & (o.needed > 0)] for o in (neural, other)]
        table[name] = {
            "optimal_given_found": st.equivalent_proportions(
                *k, margins["optimal_given_found_margin"]
            ),
            "optimal_only_in_exploitation": st.equivalent_proportions(
                *late, margins["optimal_only_in_exploitation_margin"]
            ),
            "behaviors_to_optimal": st.equivalent_means(
                *needed, margins["behaviors_to_optimal_margin"]
            ),
        }
    return table


def yoked(
    runs: Runs, result: Success, explored: np.ndarray, learning: discrete.Learning
) -> dict[str, Any]:
    """The discrete learner fed with the transitions of the neural runs: correlations over time."""
    which = np.flatnonzero(result.found)
    if len(which) == 0:
        return {"yoked_correlation": None, "yoked": {}}
    behaviors = runs.behaviors[which]
    at = tuple(range(20, behaviors.shape[1] - 1, 20))
    # Values after the transition that ends with onset k + 1 are known at onset k + 1.
    n, onsets = runs.weights.shape[-1], tuple(range(behaviors.shape[1]))
    _, kept = discrete.yoked(learning, behaviors, runs.rewarded[which], n, onsets)
    curve = {}
    for k in at:
        going = behaviors[:, k] >= 0
        r = correlation(runs.weights[which, k][going], kept[k][going])
        r = r[np.isfinite(r)]
        if len(r) > len(which) / 2:
            curve[k] = float(r.mean())
    last = explored[which] - 1
    own = runs.weights[which, last]
    other = np.stack([kept[k][row] for row, k in enumerate(last)])
    r = correlation(own, other)
    r = r[np.isfinite(r)]
    early = (runs.rewarded & (np.arange(runs.rewarded.shape[1]) < explored[:, None])).sum(1)[which]
    return {
        "yoked_correlation": float(r.mean()) if len(r) else None,
        "yoked": {
            "interval_of_mean": st.mean_interval(r),
            "summary": st.summary(r),
            "slope": float((own * other).sum() / max((other**2).sum(), 1e-12)),
            "rmse": float(np.sqrt(((own - other) ** 2).mean()) / max(abs(other).max(), 1e-12)),
            "lowest": float(r.min()) if len(r) else None,
            "over_behaviors": curve,
            "learning_rate": learning.rate,
            "lambda": learning.trace_decay,
            "finds_while_exploring": st.summary(early),
        },
    }


def yoked_optimal(
    runs: Runs,
    explored: np.ndarray,
    config: Config,
    sequences: tuple[str, ...],
    learning: discrete.Learning,
) -> list[int]:
    """``[k, n]``: the discrete learner of the same exploration then follows its values.

    How many of those whose exploration found one of ``sequences`` earn what an agent has to
    earn to be called optimal.
    """
    n, each, count = len(config.colors), np.arange(len(explored)), int(explored.max())
    if count == 0:
        return [0, 0]
    behaviors = np.where(np.arange(count) < explored[:, None], runs.behaviors[:, :count], -1)
    found = (runs.rewarded[:, :count] & (behaviors >= 0)).any(1)
    values, _ = discrete.yoked(learning, behaviors, runs.rewarded[:, :count], n)
    choice = discrete.greedy(values, np.arange(n) / n, rectified=True)
    targets = np.array([indices(sequence, config.colors) for sequence in sequences])
    state, rewards = behaviors[each, explored - 1], np.zeros(len(each), int)
    recent = np.full((len(each), targets.shape[1]), -1)
    for k in range(2 * LOOK_BACK):  # the first half to come into the loop
        state = choice[each, state]
        recent = np.c_[recent[:, 1:], state]
        rewards += (recent[:, None] == targets).all(-1).any(-1) & (k >= LOOK_BACK)
    return proportion(rewards >= needed_rewards(config), found)

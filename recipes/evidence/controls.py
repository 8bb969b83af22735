"""What each part of the model is good for: the same runs with one thing changed.

Controls: a trace of one item (TD(0)), a trace too short, no learning in exploitation, no
offset pulse. Misprints: each printed number or formula that the library deviates from
(docs/deviations.md), put back alone. 200 runs each of 100,000 steps in the abstract world;
prints a line a control and whether it failed as dntorch/paper/predictions.json says. Two
minutes on two idle cores, resumable. Source: section IV.A and the equations of Kazerounian, Luciw,
Richter and Sandamirskaya, "Autonomous Reinforcement of Behavioral Sequences in Neural
Dynamics".

    python recipes/evidence/controls.py --runs 200 --out runs/controls
"""

import argparse
from pathlib import Path

from tqdm import tqdm

from dntorch.files import write_json
from dntorch.paper.points import Point, entry, job
from dntorch.paper.populations import Population
from dntorch.paper.predictions import predictions
from dntorch.paper.runs import runs_from_events
from dntorch.paper.success import neural_success, proportion
from dntorch.process import commit
from dntorch.runs.config import Config
from dntorch.runs.group import Group
from dntorch.runs.jobs import Job, run_groups

#: Changes of numbers: all in one batch.
NUMBERS = [
    Point("default", {}),
    Point("short_trace", {"learner.trace.tau": 0.1}),
    Point("printed_intention_inhibition", {"behaviors.intention.inhibition": 10.0}),
    Point("printed_completion_gain", {"behaviors.completion_gain": 5.0}),
    Point("printed_cos_no_memory", {
        "behaviors.satisfaction.excitation": 4.0, "behaviors.satisfaction.inhibition": 0.0}),
    Point("printed_cos_no_rivalry", {"behaviors.satisfaction.inhibition": 0.0}),
]  # fmt: skip
#: Changes of structure, and to numbers that the library refuses: a batch each.
STRUCTURE = [
    "single_item", "no_offset", "printed_pairs", "printed_pulse_threshold", "printed_rest",
    "printed_sigmoid", "printed_value_nodes",
]  # fmt: skip


def judge(e: dict, default: dict, expected: dict) -> bool | None:
    """Whether a control failed in the way that was predicted, None without a prediction."""
    k, n = e["optimal_given_found"]
    share = k / n if n else 0.0
    usual = default["optimal_given_found"]
    checks = {
        "optimal_given_found_at_most": lambda limit: share <= limit,
        "optimal_given_found_below_main": lambda _: share < usual[0] / max(usual[1], 1),
        "behaviors_at_most_share": lambda limit: (
            e["behaviors_in_exploration"] <= limit * default["behaviors_in_exploration"]
        ),
        "steps_with_two_intentions_at_least_times": lambda times: (
            e["steps_with_two_intentions"] >= times * default["steps_with_two_intentions"]
        ),
        "largest_weight_at_least_times": lambda times: (
            e["largest_weight"] >= times * default["largest_weight"]
        ),
        "late_at_most": lambda limit: e.get("late", [0])[0] <= limit,
    }
    for key, limit in expected.items():
        if key in checks:
            return bool(checks[key](limit))
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=Config.steps)
    parser.add_argument("--explore", type=int, default=Config.explore)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/controls"))
    a = parser.parse_args()
    config = Config(world="nodes", seed=a.seed, steps=a.steps, explore=a.explore)
    agents = tuple(range(a.runs))
    jobs = [job("numbers", config, NUMBERS, a.runs)]
    jobs += [
        Job(name, Population(config, agents, variant=name, keep_weights=False))
        for name in STRUCTURE
    ]
    frozen = Group(config, agents, learns_in_exploitation=False)
    jobs += [Job("no_learning_in_exploitation", frozen)]
    with tqdm(total=len(jobs) * config.steps, unit="step", unit_scale=True) as bar:
        events = run_groups(
            jobs, a.out / "parts", a.processes, lambda done: bar.update(done - bar.n), batches=1
        )

    names = [point.name for point in NUMBERS]
    table = dict(zip(names, entry(events["numbers"], config, a.runs)))
    for name in STRUCTURE:
        table[name] = entry(events[name], config, a.runs)[0]
    frozen = events["no_learning_in_exploitation"]
    table["no_learning_in_exploitation"] = entry(frozen, config, a.runs)[0]
    result, _, _ = neural_success(runs_from_events(frozen, a.runs), config)
    table["no_learning_in_exploitation"]["late"] = proportion(result.late, result.found)

    expected = predictions("controls")
    for name, e in table.items():
        prediction = expected.get(name, {})
        e["as_predicted"] = judge(e, table["default"], prediction)
        e["as_revised"] = judge(e, table["default"], prediction.get("revised", {}))
        k, n = e["optimal_given_found"]
        print(f"{name:30} behaviours {e['behaviors_in_exploration']:6.1f}  found {n:3}  optimal "
              f"{k:3}  two intentions {e['steps_with_two_intentions']:8.1f}  no state "
              f"{e['steps_without_state']:8.1f}  largest |W| {e['largest_weight']:9.3g}  "
              f"as predicted: {e['as_predicted']}  as revised: {e['as_revised']}")  # fmt: skip
    content = {"runs": a.runs, "seed": a.seed, "commit": commit(), "controls": table}
    write_json(a.out / "controls.json", content)


if __name__ == "__main__":
    main()

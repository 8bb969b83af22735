"""The agent beyond the paper: what each of its parts does, beside what it is without.

Each section runs its lines as batches in the abstract world and prints a row a line, with the
number of runs and an interval; ``predictions.json`` says what was expected. Sections:

search       behaviours to the first reward, for sequences drawn from all: chance, and habituation
             to behaviours in contexts of 0 to 4 completions
lamp         the same for 6 colours where a lamp shows each right item: curiosity
autonomous   no phases, small noise: optimal at the end, rewards; edges of noise and learning rate
recall       sequences that the last completion cannot tell
change       another sequence is rewarded from the middle on
missing      a colour is nowhere
constraints  each behaviour is possible after two others only

Beside the agents, where it says so, discrete SARSA(lambda) that chooses by the same rule. An hour
on two idle cores for all, resumable.

    python recipes/evidence/beyond.py search lamp --runs 100 --out runs/beyond
    python recipes/evidence/beyond.py recall --world ring --lines "GBGYG, recall 1" --runs 60
"""

import argparse
from pathlib import Path

from tqdm import tqdm

from dntorch.files import write_json
from dntorch.paper.beyond import SECTIONS, describe, discrete, placed, shortened
from dntorch.paper.beyond_figures import draw, told
from dntorch.paper.predictions import predictions
from dntorch.process import commit
from dntorch.runs.jobs import Job, run_groups


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--world", choices=["nodes", "ring"], default="nodes")
    parser.add_argument("--lines", nargs="+", help="names of lines; by default all")
    parser.add_argument("--steps", type=int, help="control steps of a line at most")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/beyond"))
    a = parser.parse_args()
    if unknown := set(a.sections) - set(SECTIONS):
        parser.error(f"{', '.join(sorted(unknown))}: choose from {', '.join(SECTIONS)}")
    expected = predictions("beyond")
    for section in a.sections or SECTIONS:
        lines = SECTIONS[section](a.seed, a.runs)
        names = {name: f"{section}-{a.world}-{k}" for k, name in enumerate(lines)}
        if a.lines is not None and (unknown := set(a.lines) - set(lines)):
            parser.error(f"{unknown} in {section}: choose from {', '.join(lines)}")
        lines = {
            name: placed(shortened(group, a.steps), a.world)
            for name, group in lines.items()
            if a.lines is None or name in a.lines
        }
        jobs = [Job(names[name], group) for name, group in lines.items()]
        total = sum(group.config.steps for group in lines.values())
        with tqdm(total=total, unit="step", unit_scale=True, desc=section) as bar:
            events = run_groups(
                jobs, a.out / "parts", a.processes, lambda n: bar.update(n - bar.n), batches=1
            )
        rows = {name: describe(group, events[names[name]]) for name, group in lines.items()}
        for name, group in lines.items():
            if (
                section in ("search", "recall", "change")
                and group.config.explore == group.config.steps
            ):
                rows[name]["discrete"] = discrete(group, rows[name])
        for name, row in rows.items():
            print(f"{name:32}", told(row))
        content = {"runs": a.runs, "seed": a.seed, "commit": commit(), "lines": rows}
        name = section if a.world == "nodes" else f"{section}-{a.world}"
        write_json(a.out / f"{name}.json", content | {"predicted": expected[section]})
        draw(section, rows).savefig(a.out / f"beyond_{name}.png", dpi=100, facecolor="white")


if __name__ == "__main__":
    main()

"""The command that runs the agent beyond the paper."""

from pathlib import Path

import click

from dntorch.commands.common import MOST_PROCESSES, Computing, progress_bar, stoppable
from dntorch.commands.kinds import NEW_FOLDER, Parsed, whole
from dntorch.extras import require
from dntorch.lock import owned

NAMES = ("search", "lamp", "autonomous", "recall", "change", "missing", "constraints")


def _listed(text: str) -> list[str]:
    names = [name.strip() for name in text.split(";")]
    if not all(names):
        raise ValueError("give names with ; between, such as 'autonomous; two phases'")
    return names


@click.command(cls=Computing)
@click.argument("sections", nargs=-1, type=click.Choice(NAMES), metavar="[SECTIONS]...")
@click.option("--runs", type=whole(2, 10_000), default=100, show_default=True, help="Per line.")
@click.option("--seed", type=whole(0, 1_000_000), default=1, show_default=True, help="Of all runs.")
@click.option(
    "--world",
    type=click.Choice(["nodes", "ring"]),
    default="nodes",
    show_default=True,
    help="The abstract one, or camera images.",
)
@click.option(
    "--lines",
    type=Parsed(_listed),
    metavar="NAMES",
    help="Lines of a section, with ; between.",
)
@click.option("--steps", type=whole(1, 10_000_000), help="Control steps of a line at most.")
@click.option(
    "--processes", type=whole(1, MOST_PROCESSES), default=2, show_default=True, help="At once."
)
@click.option(
    "--out",
    type=NEW_FOLDER,
    default=Path("runs/beyond"),
    show_default=True,
    help="Folder; called again, it goes on with what is not finished.",
)
def beyond(sections, runs, seed, world, lines, steps, processes, out) -> None:
    """Run the agent beyond the paper, and judge what was predicted.

    \b
    search       behaviours to the first reward: chance, and habituation of each order
    lamp         the same where a lamp shows each right item: curiosity
    autonomous   no phases, small noise; edges of noise and learning rate
    recall       sequences that the last completion cannot tell
    change       another sequence is rewarded from the middle on
    missing      a colour is nowhere
    constraints  each behaviour is possible after two others only

    Without SECTIONS it runs all, in an hour or two on two cores. OUT gets report.html.
    """
    require("numpy", "tqdm", "matplotlib", "jinja2", "scipy")
    from dntorch.paper import beyond_study as study

    names = sections or tuple(name for name in NAMES if world == "nodes")
    planned = {name: study.lines_of(name, seed, runs, world, lines or [], steps) for name in names}
    if not planned:
        raise ValueError(f"--world={world}: name sections, such as autonomous, recall and change")
    out.mkdir(parents=True, exist_ok=True)
    with owned(out), stoppable("the same command goes on with what is left"):
        for section, chosen in planned.items():
            total = sum(group.config.steps for _, group in chosen.values())
            bar = {"total": total, "unit": "step", "unit_scale": True, "desc": section}
            with progress_bar(**bar) as counter:

                def progress(done: int, counter=counter) -> None:
                    counter.update(done - counter.n)

                rows = study.run_section(section, chosen, out, processes, progress)
            for claim in study.judge(section, rows):
                click.echo(f"{claim.verdict:7} {claim.sentence}: {claim.form}: {claim.number}")
        command = f"dntorch beyond {' '.join(names)} --world {world} --runs {runs} --seed {seed}"
        click.echo(f"report: {study.write_page(out, command)}")

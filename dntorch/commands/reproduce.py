"""``dntorch reproduce``: the paper's claims over many runs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dntorch.commands.common import (
    MOST_PROCESSES,
    MOST_RUNS,
    OF_A_RUN,
    RUNS,
    Computing,
    new_folder,
    progress_bar,
    refuse_options,
    stoppable,
)
from dntorch.commands.kinds import NEW_FOLDER, OLD_FOLDER, whole
from dntorch.commands.options import build_config, options_of_a_run, spelled
from dntorch.extras import require
from dntorch.runs.config import FIELDS, Config, kept_config
from dntorch.runs.worlds import WORLDS

if TYPE_CHECKING:
    from dntorch.paper.study import Study

#: With these the paper's claims say nothing.
OTHER_TASKS = ("recall", "then", "change", "missing")

OPTIONS = "options.pt"
"""What a folder was begun with."""


@click.command(cls=Computing)
@options_of_a_run(without=OTHER_TASKS, autonomous=False, world="nodes")
@click.option("--runs", type=whole(1, MOST_RUNS), default=1000, show_default=True)
@click.option("--processes", type=whole(1, MOST_PROCESSES), default=2, show_default=True)
@click.option(
    "--out",
    type=NEW_FOLDER,
    help="New folder for the runs.  [default: runs/reproduce-WORLD-seedSEED]",
)
@click.option(
    "--resume",
    type=OLD_FOLDER,
    help="Folder to go on with; it keeps the options it began with.",
)
@click.pass_context
def reproduce(context, file, runs, processes, out, resume, **options) -> None:
    """Test the paper's claims with many runs.

    The folder gets results.json, figures and report.html, which puts each sentence of the
    paper beside our number, its interval and a verdict.

    In the world nodes --seed is that of all runs; in the others it is that of the first, and the
    next take the next numbers.
    """
    require("numpy", "tqdm", "matplotlib", "jinja2", "scipy", "statsmodels")
    from dntorch import files
    from dntorch.runs.build import build_agent

    if resume:
        refuse_options(context, {"resume"}, OF_A_RUN)
        folder, saved = resume, files.load(resume / OPTIONS)
        runs, processes = saved.pop("runs", None), saved.pop("processes", None)
        config = kept_config(saved, resume / OPTIONS)
        _check(config, runs)
    else:
        config = build_config(file, options)
        _check(config, runs)
        build_agent(config)  # raises for a value that makes none, before there is a folder
        folder = out or Path("runs") / f"reproduce-{config.world}-seed{config.seed}"
        new_folder(folder, RUNS, f"go on with --resume {folder} or name another")
        content = vars(config) | {"runs": runs, "processes": processes}
        files.save(folder / OPTIONS, content)
    with stoppable(f"go on with: dntorch reproduce --resume {folder}"):
        study = _run(config, runs, folder, processes)
        command = f"dntorch reproduce --world {config.world} --runs {runs}"
        _report(study, folder, f"{command} {spelled(config, world=config.world)}".rstrip())


def _check(config: Config, runs: int) -> None:
    """Raise for runs that cannot be made, before there is a folder."""
    row = WORLDS[config.world]
    require(*row.packages, instead="give --world ring")
    if not row.numbered and config.seed + runs - 1 not in FIELDS["seed"].metadata["within"]:
        raise ValueError(
            f"--seed={config.seed} leaves no seeds for --runs={runs}: give a smaller one"
        )


def _run(config: Config, runs: int, folder: Path, processes: int) -> "Study":
    from dntorch.paper import reproduce as reproducing

    total = reproducing.steps_to_take(config, runs, processes)
    counting = {"total": total, "unit": "step", "unit_scale": True}
    with progress_bar(**counting) as bar:
        return reproducing.reproduce(
            config, runs, folder, processes, lambda done: bar.update(done - bar.n)
        )


def _report(study: "Study", folder: Path, command: str) -> None:
    from dntorch.paper.claims import claims
    from dntorch.paper.figures import draw
    from dntorch.paper.page import write_page

    click.echo("drawing figures ...", err=True)
    page = write_page(study, draw(study, folder), folder, command)
    for claim in claims(study):
        click.echo(f"{claim.verdict:16} {claim.form}: {claim.number}")
    click.echo(f"report: {page}")

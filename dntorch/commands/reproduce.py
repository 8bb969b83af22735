"""``dntorch reproduce``: the paper's claims over many runs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dntorch.commands.common import OF_A_RUN, RUNS, Computing, new_folder, refuse_options
from dntorch.commands.options import build_config, options_of_a_run, spelled
from dntorch.process import end_when_asked
from dntorch.runs.config import Config

if TYPE_CHECKING:
    from dntorch.paper.study import Study

OPTIONS = "options.pt"
"""What a folder was begun with."""


@click.command(cls=Computing)
@options_of_a_run(world="nodes")
@click.option("--runs", type=click.IntRange(1), default=1000, show_default=True)
@click.option("--processes", type=click.IntRange(1), default=2, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="New folder for the runs.  [default: runs/reproduce-WORLD-seedSEED]",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to go on with; it keeps the options it began with.",
)
@click.pass_context
def reproduce(context, file, runs, processes, out, resume, **options) -> None:
    """Test the paper's claims with many runs.

    The folder gets results.json, figures and report.html, which puts each sentence of the
    paper beside our number, its interval and a verdict.

    In the world nodes, --seed is that of all runs; in epuck it is that of the first, and the
    next take the next numbers.
    """
    from dntorch import files
    from dntorch.runs.build import build_agent

    if resume:
        refuse_options(context, {"resume"}, OF_A_RUN)
        folder, saved = resume, files.load(resume / OPTIONS)
        runs, processes = saved.pop("runs"), saved.pop("processes")
        config = Config(**saved)
    else:
        config = build_config(file, options)
        build_agent(config)  # raises for a value that makes none, before there is a folder
        folder = out or Path("runs") / f"reproduce-{config.world}-seed{config.seed}"
        new_folder(folder, RUNS, f"go on with --resume {folder} or name another")
        content = vars(config) | {"runs": runs, "processes": processes}
        files.save(folder / OPTIONS, content)
    study = _run(config, runs, folder, processes)
    command = f"dntorch reproduce --world {config.world} --runs {runs}"
    _report(study, folder, f"{command} {spelled(config, world=config.world)}".rstrip())


def _run(config: Config, runs: int, folder: Path, processes: int) -> "Study":
    from tqdm import tqdm

    from dntorch.paper import reproduce as reproducing

    end_when_asked()
    total = reproducing.steps_to_take(config, runs, processes)
    with tqdm(total=total, unit="step", unit_scale=True) as bar:
        try:
            return reproducing.reproduce(
                config, runs, folder, processes, lambda done: bar.update(done - bar.n)
            )
        except KeyboardInterrupt:
            bar.close()
            click.echo(f"stopped; go on with: dntorch reproduce --resume {folder}", err=True)
            raise


def _report(study: "Study", folder: Path, command: str) -> None:
    from dntorch.paper.claims import claims, write_page
    from dntorch.paper.figures import draw

    click.echo("drawing figures ...", err=True)
    page = write_page(study, draw(study, folder), folder, command)
    for claim in claims(study):
        click.echo(f"{claim.verdict:16} {claim.form}: {claim.number}")
    click.echo(f"report: {page}")

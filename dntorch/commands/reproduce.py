"""``dntorch reproduce``: the paper's claims over many runs."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from tqdm import tqdm

from dntorch import files
from dntorch.commands.common import OF_A_RUN, RUNS, new_folder, refuse_options
from dntorch.process import end_when_asked
from dntorch.runs.config import WORLDS, Config

if TYPE_CHECKING:
    from dntorch.paper.study import Study

OPTIONS = "options.pt"
"""What a folder was begun with."""


@click.command()
@click.option(
    "--world", type=click.Choice(WORLDS), default="nodes", show_default=True,
    help="Abstract behaviours, or PyBullet with a camera.",
)  # fmt: skip
@click.option("--runs", type=click.IntRange(1), default=1000, show_default=True)
@click.option(
    "--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True,
    help="nodes: of all runs; epuck: of the first, the next take the next numbers.",
)  # fmt: skip
@click.option(
    "--explore", type=int, default=Config.explore, show_default=True,
    help="Control steps of exploration (32 a second).",
)  # fmt: skip
@click.option(
    "--steps", type=int, default=Config.steps, show_default=True, help="Control steps in all."
)
@click.option("--processes", type=click.IntRange(1), default=2, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False),
    help="New folder for the runs.  [default: runs/reproduce-WORLD-seedSEED]",
)  # fmt: skip
@click.option(
    "--resume", type=click.Path(path_type=Path, file_okay=False),
    help="Folder to go on with; it keeps the options it began with.",
)  # fmt: skip
@click.pass_context
def reproduce(context, world, runs, seed, explore, steps, processes, out, resume) -> None:
    """Test the paper's claims with many runs.

    The folder gets results.json, figures and report.html, which puts each sentence of the
    paper beside our number, its interval and a verdict.
    """
    if resume:
        refuse_options(context, {"resume"}, OF_A_RUN)
        folder, saved = resume, files.load(resume / OPTIONS)
        runs, processes = saved.pop("runs"), saved.pop("processes")
        config = Config(**saved)
    else:
        config = replace(Config(), world=world, seed=seed, explore=explore, steps=steps)
        folder = out or Path("runs") / f"reproduce-{world}-seed{seed}"
        new_folder(folder, RUNS, f"go on with --resume {folder} or name another")
        content = vars(config) | {"runs": runs, "processes": processes}
        files.save(folder / OPTIONS, content)
    study = _run(config, runs, folder, processes)
    options = {"world": config.world, "runs": runs, "seed": config.seed, "explore": config.explore,
               "steps": config.steps}  # fmt: skip
    given = " ".join(f"--{name} {value}" for name, value in options.items())
    _report(study, folder, f"dntorch reproduce {given}")


def _run(config: Config, runs: int, folder: Path, processes: int) -> "Study":
    from dntorch.paper import reproduce as reproducing  # scipy takes its time

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

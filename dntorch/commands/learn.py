"""The command that trains one agent."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dntorch.commands.common import (
    OF_A_RUN,
    RUNS,
    Computing,
    new_folder,
    progress_bar,
    refuse_options,
    stoppable,
)
from dntorch.commands.kinds import NEW_FOLDER, OLD_FOLDER
from dntorch.commands.options import CHECKPOINT_EVERY, COMPILE, build_config, options_of_a_run
from dntorch.extras import has, require
from dntorch.lock import owned
from dntorch.process import pays
from dntorch.runs.config import Config
from dntorch.runs.logs import LOGGERS, open_log
from dntorch.runs.worlds import WORLDS

if TYPE_CHECKING:
    from dntorch.runs.run import Trial

ELSEWHERE = (
    "PyBullet is not installed (it has wheels for Linux and Python 3.10 and 3.11): the run "
    "goes to --world ring, the same ring of blocks seen in torch"
)

#: The smallest from 1 with which the default run finds the sequence while it explores.
DEFAULT_SEED = 1


@click.command(cls=Computing)
@options_of_a_run(seed=DEFAULT_SEED)
@click.option(
    "--out",
    type=NEW_FOLDER,
    help="New folder for the run.  [default: runs/WORLD-seedSEED]",
)
@click.option(
    "--resume",
    type=OLD_FOLDER,
    help="Folder of a run to go on with; it keeps the options it began with.",
)
@CHECKPOINT_EVERY
@click.option("--video/--no-video", default=True, show_default=True, help="Film the trained agent.")
@click.option(
    "--log", type=click.Choice(LOGGERS), help="Log progress, with TorchRL's loggers, in OUT/log."
)
@COMPILE
@click.pass_context
def learn(context, file, out, resume, checkpoint_every, video, log, compiled, **options) -> None:
    """Train one agent and write a report.

    It explores at random, then exploits what it learned, and learns all along. The folder
    gets results.json, checkpoint.pt, record.npz, figures, a video and report.html.
    """
    require("numpy", "tqdm", "matplotlib", "jinja2")
    if log:
        require("torchrl", *(("tensorboard",) if log == "tensorboard" else ()))
    from dntorch.runs.run import Trial
    from dntorch.runs.train import CHECKPOINT

    if resume:
        refuse_options(context, {"resume", "checkpoint_every", "video", "log"}, OF_A_RUN)
        trial, folder = None, resume
    else:
        asked = build_config(file, options)
        config = within_reach(asked)
        _require_film(config, video)
        # Raises for a value that makes none, before there is a folder.
        trial = Trial(config, compiled and pays(config.steps))
        folder = out or Path("runs") / f"{config.world}-seed{config.seed}"
        new_folder(folder, RUNS, f"go on with --resume {folder} or name another")
        if config != asked:
            click.echo(ELSEWHERE, err=True)
    with owned(folder), stoppable(f"go on with: dntorch learn --resume {folder}"):
        if trial is None:
            trial = Trial.load(folder / CHECKPOINT)
            _require_film(trial.config, video)
        else:
            trial.save(folder / CHECKPOINT)
        _train(trial, folder, checkpoint_every, video, open_log(log, folder) if log else None)


def within_reach(config: Config) -> Config:
    """The same run in a world that can be had here."""
    row = WORLDS[config.world]
    if not row.instead or all(map(has, row.packages)):
        return config
    return replace(config, world=row.instead)


def _require_film(config: Config, video: bool) -> None:
    if video and WORLDS[config.world].env is not None:
        require("cv2", "gymnasium", instead="give --no-video")


def _train(trial: "Trial", folder: Path, checkpoint_every: int, video: bool, log=None) -> None:
    from dntorch.runs import train as learning

    begun_at, config = trial.step, trial.config
    counting = {"total": config.steps, "initial": begun_at, "unit": "step", "smoothing": 0.1}
    with progress_bar(**counting) as bar:

        def progress(trial: "Trial") -> None:
            bar.set_description("explore" if trial.step <= config.explore else "exploit", False)
            bar.set_postfix(
                behaviors=len(trial.record.behaviors), rewards=len(trial.record.rewards),
                refresh=False,
            )  # fmt: skip
            if trial.compiled and bar.n == begun_at:
                bar.write(f"compiled the step in {trial.engine.compiling:.0f} s", sys.stderr)
            bar.update(trial.step - bar.n)
            if log:
                log(trial)

        seconds = learning.train(trial, folder / learning.CHECKPOINT, checkpoint_every, progress)
    trial.close()
    results = learning.results(trial, trial.step - begun_at, seconds)
    results = learning.write_results(trial, folder, results)
    report = _report(trial, folder, results, video)
    click.echo(
        f"{results['behaviors']} behaviours, {len(results['rewards'])} rewards, optimal at the "
        f"end: {'yes' if results['optimal_at_end'] else 'no'}\nreport: {report}"
    )


def _report(trial: "Trial", folder: Path, results: dict, video: bool) -> Path:
    from dntorch.show.figures import write_figures
    from dntorch.show.report import write_report

    video = video and WORLDS[trial.config.world].env is not None
    click.echo(f"drawing figures{' and film' if video else ''} ...", err=True)
    write_figures(trial.record, trial.config, folder)
    if video:
        from dntorch.show.film import write_video  # OpenCV is an extra

        write_video(trial.agent, trial.config, folder / "video.webm")
    return write_report(folder, results, trial.config)

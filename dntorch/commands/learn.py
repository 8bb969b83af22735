"""The command that trains one agent."""

from pathlib import Path

import click
from tqdm import tqdm

from dntorch.commands.common import OF_A_RUN, RUNS, new_folder, refuse_options
from dntorch.process import end_when_asked
from dntorch.runs import train as learning
from dntorch.runs.build import build_agent
from dntorch.runs.config import WORLDS, Config
from dntorch.runs.logs import LOGGERS, open_log
from dntorch.runs.trial import Trial

#: A seed with which the default run finds the sequence while it explores.
DEFAULT_SEED = 1


@click.command()
@click.option(
    "--world",
    type=click.Choice(WORLDS),
    default=Config.world,
    show_default=True,
    help="PyBullet with a camera, or abstract behaviours.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**32 - 1),
    default=DEFAULT_SEED,
    show_default=True,
    help="Of layout, exploration and durations.",
)
@click.option(
    "--explore",
    type=int,
    default=Config.explore,
    show_default=True,
    help="Control steps of exploration (32 a second).",
)
@click.option(
    "--steps", type=int, default=Config.steps, show_default=True, help="Control steps in all."
)
@click.option(
    "--sequence",
    default=Config.sequence,
    show_default=True,
    help="Colours that are rewarded in this order.",
)
@click.option(
    "--colors", default=Config.colors, show_default=True, help="Colours to look for, of ROYGCBVM."
)
@click.option(
    "--camera",
    default=f"{Config.width}x{Config.height}",
    show_default=True,
    help="Image size, WIDTHxHEIGHT.",
)
@click.option(
    "--integrator",
    type=click.Choice(["euler", "heun"]),
    default=Config.integrator,
    show_default=True,
    help="Of the neural dynamics.",
)
@click.option(
    "--substeps",
    type=int,
    default=Config.substeps,
    show_default=True,
    help="Integrator steps in a control step.",
)
@click.option(
    "--learning-rate",
    type=float,
    default=Config.learning_rate,
    show_default=True,
    help="Per second.",
)
@click.option(
    "--dt", type=float, default=Config.dt, show_default=True, help="Seconds a control step."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="New folder for the run.  [default: runs/WORLD-seedSEED]",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of a run to go on with; it keeps the options it began with.",
)
@click.option(
    "--checkpoint-every",
    type=click.IntRange(1),
    default=5_000,
    show_default=True,
    help="Control steps between two checkpoints.",
)
@click.option("--video/--no-video", default=True, show_default=True, help="Film the trained agent.")
@click.option(
    "--log", type=click.Choice(LOGGERS), help="Log progress, with TorchRL's loggers, in OUT/log."
)
@click.pass_context
def learn(context, out, resume, checkpoint_every, video, log, camera, **options) -> None:
    """Train one agent and write a report.

    It explores at random, then exploits what it learned, and learns all along. The folder
    gets results.json, checkpoint.pt, record.npz, figures, a video and report.html.
    """
    if resume:
        refuse_options(context, {"resume", "checkpoint_every", "video", "log"}, OF_A_RUN)
        trial, folder = Trial.load(resume / learning.CHECKPOINT), resume
    else:
        width, height = _size(camera)
        config = Config(**options, width=width, height=height)
        build_agent(config)  # raises for a value that makes none, before there is a folder
        folder = out or Path("runs") / f"{config.world}-seed{config.seed}"
        remedy = f"go on with --resume {folder} or name another"
        new_folder(folder, RUNS, remedy)
        trial = Trial(config)
        trial.save(folder / learning.CHECKPOINT)
    _train(trial, folder, checkpoint_every, video, open_log(log, folder) if log else None)


def _train(trial: Trial, folder: Path, checkpoint_every: int, video: bool, log=None) -> None:
    end_when_asked()
    begun_at, config = trial.step, trial.config
    with tqdm(total=config.steps, initial=begun_at, unit="step", smoothing=0.1) as bar:

        def progress(trial: Trial, steps: int) -> None:
            bar.set_description("explore" if trial.step <= config.explore else "exploit", False)
            bar.set_postfix(
                behaviors=len(trial.record.behaviors), rewards=len(trial.record.rewards),
                refresh=False,
            )  # fmt: skip
            bar.update(steps)
            if log:
                log(trial)

        try:
            seconds = learning.train(trial, folder, checkpoint_every, progress)
        except KeyboardInterrupt:
            bar.close()
            click.echo(f"stopped; go on with: dntorch learn --resume {folder}", err=True)
            raise
    trial.close()
    results = learning.results(trial, trial.step - begun_at, seconds)
    learning.write_results(trial, folder, results)
    report = _report(trial, folder, results, video)
    click.echo(
        f"{results['behaviors']} behaviours, {len(results['rewards'])} rewards, optimal at the "
        f"end: {'yes' if results['optimal_at_end'] else 'no'}\nreport: {report}"
    )


def _report(trial: Trial, folder: Path, results: dict, video: bool) -> Path:
    from dntorch.show.figures import write_figures
    from dntorch.show.film import write_video
    from dntorch.show.report import write_report

    click.echo("drawing figures and film ...", err=True)
    write_figures(trial.record, trial.config, folder)
    if video and trial.config.world == "epuck":
        write_video(trial.agent, trial.config, folder / "video.webm")
    return write_report(folder, results, trial.config)


def _size(camera: str) -> tuple[int, int]:
    width, _, height = camera.partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise ValueError(f"--camera={camera!r} is no image size: give WIDTHxHEIGHT, such as 52x39")
    return int(width), int(height)

"""Commands that drive a robot: a real one that was named, or an emulator of their own."""

import select
import sys
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dntorch.body import EPUCK, FASTEST
from dntorch.commands.calibrate import calibrate, measure
from dntorch.commands.common import Computing, new_folder, progress_bar
from dntorch.commands.kinds import NEW_FOLDER, OLD_FILE, OLD_FOLDER, Number, whole
from dntorch.commands.target import Target, open_target, options_of_target
from dntorch.extras import require
from dntorch.process import end_when_asked, postponed
from dntorch.quantities import Interval
from dntorch.runs.config import LONGEST, Config

if TYPE_CHECKING:
    from dntorch.drive.driving import Trip
    from dntorch.envs.hardware import HardwareEnv
    from dntorch.robot.calibration import Calibration
    from dntorch.show.reel import Reel


@click.group()
def robot() -> None:
    """Drive an e-puck: a real one that is named, or an emulated one."""
    end_when_asked()


@robot.command(cls=Computing)
@click.argument("run", type=OLD_FOLDER)
@options_of_target
@click.option(
    "--learn/--no-learn", default=False, show_default=True, help="Go on learning from rewards."
)
@click.option(
    "--iterations", type=whole(1, LONGEST), default=2, show_default=True,
    help="Of the rewarded sequence; then it ends.",
)  # fmt: skip
@click.option(
    "--steps", type=whole(1, LONGEST), default=20_000, show_default=True,
    help="Control steps after which it ends at the latest (32 a second).",
)  # fmt: skip
@click.option(
    "--calibration", "file", type=OLD_FILE,
    help="Of `dntorch robot calibrate`.  [default: it turns once around first to make one]",
)  # fmt: skip
@click.option(
    "--speed-cap",
    type=Number(Interval(0, FASTEST, above=True, unit="rad/s")),
    default=EPUCK.speed_cap,
    show_default=True,
    help="Of a wheel, rad/s.",
)
@click.option(
    "--reward", type=click.Choice(["task", "key"]), default="task", show_default=True,
    help="Paid for what the agent reports, or when you press Enter.",
)  # fmt: skip
@click.option("--reconnect", is_flag=True, help="Make a lost link anew and go on.")
@click.option("--film/--no-film", default=False, show_default=True, help="Film it, for OUT.")
@click.option(
    "--out", type=NEW_FOLDER,
    help="New folder for the report, the film and what is learned.  [default: RUN/robot-N]",
)  # fmt: skip
@click.pass_context
def run(context, run, file, learn, iterations, steps, speed_cap, reward, film, out, **target):
    """Let the trained agent of a RUN drive a robot.

    Ctrl-C, Ctrl-Z, a closed terminal, an error or a lost link stop the robot, as does a process
    of its own when this one can not. RUN itself is only read: with --learn, what
    is learned goes to OUT/checkpoint.pt, which is a run of its own, after each completed
    sequence and at the end. Exit code 1 when it ended before all iterations were done.
    """
    require("tqdm", "numpy", "gymnasium", *(("cv2", "matplotlib") if film else ()))
    from dntorch.drive import driving
    from dntorch.drive.fit import fit, hardware, load_agent, save_learned
    from dntorch.robot.calibration import Calibration
    from dntorch.runs.build import build_lifelong
    from dntorch.runs.train import CHECKPOINT

    trained, config = load_agent(run)
    known = Calibration.load(file) if file else None
    pressed = _enter if reward == "key" else lambda: False

    def save() -> None:
        if learn:
            save_learned(folder / CHECKPOINT, agent, trained, config)

    with open_target(context, config, **target) as target:
        env = hardware(target.driver, target.clock, config, known, speed_cap, key=pressed)
        with env:
            folder = new_folder(out or _numbered(run), [CHECKPOINT, "report.json"])
            env.calibration = known or measure(env, config.colors, fov=target.fov)
            agent = fit(trained, config, env.calibration)
            agent.learn(learn)
            trip = driving.Trip.of(agent, config)
            reel = _reel(agent, config, target, env) if film else None
            target.seen.clear()
            act, paid = driving.acting(agent, build_lifelong(config)), reward == "task"
            try:
                with progress_bar(unit="step") as bar:
                    each = partial(_follow, bar, trip, agent, reel, save)
                    driving.perform(env, act, trip, steps, iterations, paid, each)
            finally:
                with postponed():  # who asks twice to end must not lose what was learned
                    env.close()  # the robot stands before anything is written
                    save()
                    _report(folder, trip, env.calibration, target)
        if learn:
            click.echo(f"learned values: {folder / CHECKPOINT}, a run of its own")
        if reel:
            click.echo(f"film: {reel.write(folder / 'film.webm')}")
    return 0 if len(trip.completed) >= iterations else 1


def _follow(bar, trip: "Trip", agent, reel: "Reel | None", save, step) -> None:
    """After each step: a line of progress, a look for the film, what was learned on disk."""
    from dntorch.drive.driving import spoken

    if reel:
        reel.take(step, trip)
    if step.info["completed"]:
        save()
    now = step.info["stopped"] or spoken(agent, trip.config)
    late = f"late {1e3 * trip.late[-1]:.1f} ms"
    bar.set_postfix_str(f"{now}, found {trip.letters[-12:]}, {late}", refresh=False)
    bar.update()


def _reel(agent, config: Config, target: Target, env: "HardwareEnv") -> "Reel":
    from dntorch.show.reel import Reel

    if target.emulator is not None:
        world = target.emulator.world
        return Reel(agent, config, lambda: world.pose, world.view)
    # Nobody stands outside: the image as it came.
    return Reel(agent, config, lambda: env.frame.image, title="camera, raw")


def _report(folder: Path, trip: "Trip", calibration: "Calibration", target: Target) -> None:
    from dntorch.files import write_json

    numbers = trip.summary()
    if target.emulator is not None:
        numbers["seen_by_the_world"] = "".join(trip.config.colors[color] for color in target.seen)
        numbers["faults"] = dict(target.emulator.faults.counts)
    write_json(folder / "report.json", numbers)
    calibration.save(folder / "calibration.json")
    late = numbers["late_ms"]
    click.echo(f"ended: {trip.ending}\nfound: {trip.letters or 'nothing'}")
    if target.emulator is not None:
        click.echo(f"the emulator's world saw: {numbers['seen_by_the_world'] or 'nothing'}")
    click.echo(
        f"{numbers['seconds']} s, {numbers['images_per_second']} images/s, the oldest it moved on "
        f"{numbers['oldest_image_moved_on_s']} s\nlate: median {late['median']} ms, 99 % within "
        f"{late['p99']} ms, at most {late['max']} ms\nstood: {numbers['stood_steps'] or 'never'}"
    )
    click.echo(f"report: {folder / 'report.json'}")


def _numbered(run: Path) -> Path:
    return next(run / f"robot-{k}" for k in count(1) if not (run / f"robot-{k}").exists())


def _enter() -> bool:
    """Whether Enter was pressed."""
    return bool(select.select([sys.stdin], [], [], 0)[0] and sys.stdin.readline())


robot.add_command(calibrate)

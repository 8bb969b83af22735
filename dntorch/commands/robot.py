"""Commands that drive a robot: a real one that was named, or an emulator of their own."""

import json
import select
import sys
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from tqdm import tqdm

from dntorch.body import EPUCK, FASTEST
from dntorch.colors import PAPER, check_colors
from dntorch.commands.common import new_folder
from dntorch.commands.target import Target, open_target, options_of_target
from dntorch.files import write_atomically
from dntorch.process import end_when_asked
from dntorch.runs.config import Config
from dntorch.runs.train import CHECKPOINT

if TYPE_CHECKING:
    from dntorch.drive.driving import Trip
    from dntorch.envs.hardware import HardwareEnv
    from dntorch.robot.calibration import Calibration
    from dntorch.show.reel import Reel

FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)


@click.group()
def robot() -> None:
    """Drive an e-puck: a real one that is named, or an emulated one."""
    end_when_asked()


# ---------------------------------------------------------------- run


@robot.command()
@click.argument("run", type=FOLDER)
@options_of_target
@click.option(
    "--learn/--no-learn", default=False, show_default=True, help="Go on learning from rewards."
)
@click.option(
    "--iterations", type=click.IntRange(1), default=2, show_default=True,
    help="Of the rewarded sequence; then it ends.",
)  # fmt: skip
@click.option(
    "--steps", type=click.IntRange(1), default=20_000, show_default=True,
    help="Control steps after which it ends at the latest (32 a second).",
)  # fmt: skip
@click.option(
    "--calibration", "file", type=FILE,
    help="Of `dntorch robot calibrate`.  [default: it turns once around first to make one]",
)  # fmt: skip
@click.option(
    "--speed-cap",
    type=float,
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
    "--out", type=FOLDER,
    help="New folder for the report, the film and what is learned.  [default: RUN/robot-N]",
)  # fmt: skip
@click.pass_context
def run(context, run, file, learn, iterations, steps, speed_cap, reward, film, out, **target):
    """Let the trained agent of a RUN drive a robot.

    Ctrl-C, an error or a lost link stop the robot. RUN itself is only read: with --learn, what
    is learned goes to OUT/checkpoint.pt, which is a run of its own, after each completed
    sequence and at the end. Exit code 1 when it ended before all iterations were done.
    """
    from dntorch.drive import driving
    from dntorch.drive.fit import fit, hardware, load_agent, save_learned
    from dntorch.robot.calibration import Calibration

    trained, config = load_agent(run)
    known = Calibration.load(file) if file else None
    if not 0 < speed_cap <= FASTEST:
        raise ValueError(f"--speed-cap={speed_cap}: give rad/s above 0, at most {FASTEST}")
    pressed = _enter if reward == "key" else lambda: False

    def save() -> None:
        if learn:
            save_learned(folder / CHECKPOINT, agent, trained, config)

    with open_target(context, config, **target) as target:
        env = hardware(target.driver, target.clock, config, known, speed_cap, key=pressed)
        with env:
            folder = new_folder(out or _numbered(run), [CHECKPOINT, "report.json"])
            env.calibration = known or _look_around(env, config.colors, fov=target.fov)
            agent = fit(trained, config, env.calibration)
            agent.learn(learn)
            trip = driving.Trip(config, agent.sensorimotor.scan)
            reel = _reel(agent, config, target, env) if film else None
            target.seen.clear()
            act, paid = driving.acting(agent), reward == "task"
            try:
                with tqdm(unit="step") as bar:
                    each = partial(_follow, bar, trip, agent, reel, save)
                    driving.perform(env, act, trip, steps, iterations, paid, each)
            finally:
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
    numbers = trip.summary()
    if target.emulator is not None:
        numbers["seen_by_the_world"] = "".join(trip.config.colors[color] for color in target.seen)
        numbers["faults"] = dict(target.emulator.faults.counts)
    text = json.dumps(numbers, indent=1) + "\n"
    write_atomically(folder / "report.json", lambda file: file.write(text.encode()))
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


# ---------------------------------------------------------------- calibrate


@robot.command()
@click.argument("images", nargs=-1, type=FILE)
@click.option("--to", type=FILE, required=True, help="File to write; an old one is replaced.")
@options_of_target
@click.option("--colors", default=PAPER, show_default=True, help="Of all blocks around it.")
@click.option("--rotate", type=click.Choice(["0", "90", "180", "270"]), default="0",
              show_default=True, help="Degrees counter-clockwise.")  # fmt: skip
@click.option("--mirror", is_flag=True, help="Exchange left and right, after the rotation.")
@click.option("--fov", type=float, help="Horizontal field of view, rad.")
@click.option("--axle", type=float, help="m, if it is not to be measured.")
@click.option("--fps", type=float, help="Images/s, if they are not to be counted.")
@click.option("--distance", type=float, help="m to the blocks: measures the field of view.")
@click.pass_context
def calibrate(context, images, to, colors, distance, **options) -> None:
    """Measure a robot's camera and axle, for `robot run --calibration`.

    The robot turns a little more than once on the spot, amid blocks of all the colours. With
    IMAGES, files that show the blocks all around, colours alone are measured.
    """
    check_colors(colors)
    given = {name: options.pop(name) for name in ("mirror", "fov", "axle", "fps")}
    known = {name: value for name, value in given.items() if value}
    known["rotate"] = int(options.pop("rotate"))
    assumed = ""
    if images:
        from dntorch.robot.emulated.emulator import BODIES

        protocol = options["protocol"]
        usual = {"fov": BODIES[protocol].fov, "fps": 7.0 if protocol == "wifi" else 2.6}
        made = _from_files(images, colors, usual | known)
        assumed = f" (what was not given is usual for {protocol}, not measured)"
    else:
        config = Config(colors=colors, sequence=colors)
        with open_target(context, config, **options) as robot:
            from dntorch.drive.fit import hardware

            with hardware(robot.driver, robot.clock, config) as env:
                if distance is None:
                    known.setdefault("fov", robot.fov)
                made = _look_around(env, colors, distance, **known)
    replaced = " (replaced)" if to.exists() else ""
    made.save(to)
    hues = ", ".join(f"{letter} {angle:.0f}" for letter, angle in made.hues.items())
    click.echo(
        f"gains of red, green, blue: {', '.join(f'{gain:.2f}' for gain in made.gains)}\n"
        f"hues in degrees: {hues}\nfield of view {made.fov:.3f} rad, axle {made.axle:.4f} m, "
        f"{made.fps:g} images/s{assumed}\ncalibration: {to}{replaced}"
    )


def _from_files(files: tuple[Path, ...], colors: str, known: dict[str, Any]) -> "Calibration":
    import cv2

    from dntorch.robot.calibration import calibrate

    images = []
    for file in files:
        image = cv2.imread(str(file))
        if image is None:
            raise ValueError(f"IMAGES: {file} is no image that OpenCV can read: leave it out")
        images.append(image[:, :, ::-1])
    return calibrate(images, colors, **known)


def _look_around(env: "HardwareEnv", colors: str, distance=None, **known) -> "Calibration":
    from dntorch.drive.look_around import calibrate_from, look_around

    with tqdm(total=100, unit="%", desc="looking around") as bar:
        views = look_around(env, lambda share: bar.update(round(100 * share) - bar.n))
    return calibrate_from(views, colors, distance, **known)

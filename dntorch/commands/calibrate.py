"""The command that measures a robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dntorch.body import AXLE, DISTANCE, FOV, RATE
from dntorch.colors import PAPER
from dntorch.commands.common import Computing, progress_bar, refuse_options
from dntorch.commands.kinds import NEW_FILE, OLD_FILE, Number
from dntorch.commands.options import COLORS
from dntorch.commands.target import OF_THE_EMULATOR, open_target, options_of_target
from dntorch.extras import require
from dntorch.runs.config import Config

if TYPE_CHECKING:
    from dntorch.envs.hardware import HardwareEnv
    from dntorch.robot.calibration import Calibration


@click.command(cls=Computing)
@click.argument("images", nargs=-1, type=OLD_FILE)
@click.option("--to", type=NEW_FILE, required=True, help="File to write; an old one is replaced.")
@options_of_target
@click.option(
    "--colors", type=COLORS, default=PAPER, show_default=True, help="Of all blocks around it."
)
@click.option("--rotate", type=click.Choice(["0", "90", "180", "270"]), default="0",
              show_default=True, help="Degrees counter-clockwise.")  # fmt: skip
@click.option("--mirror", is_flag=True, help="Exchange left and right, after the rotation.")
@click.option("--fov", type=Number(FOV), help="Horizontal field of view, rad.")
@click.option("--axle", type=Number(AXLE), help="m, if it is not to be measured.")
@click.option("--fps", type=Number(RATE), help="Images/s, if they are not to be counted.")
@click.option(
    "--distance", type=Number(DISTANCE), help="m to the blocks: measures the field of view."
)
@click.pass_context
def calibrate(context, images, to, colors, distance, **options) -> None:
    """Measure a robot's camera and axle, for `robot run`.

    The robot turns a little more than once on the spot, amid blocks of all the colours. With
    IMAGES, files that show the blocks all around, colours alone are measured. The file is what
    other commands read with --calibration.
    """
    given = {name: options.pop(name) for name in ("mirror", "fov", "axle", "fps")}
    known = {name: value for name, value in given.items() if value not in (None, False)}
    known["rotate"] = int(options.pop("rotate"))
    assumed = ""
    if images:
        require("cv2", "numpy")
        robots = {*OF_THE_EMULATOR, "connect", "distance"}
        why = "is of a robot that turns, but IMAGES were given"
        refuse_options(context, context.params.keys() - robots, why)
        from dntorch.robot.emulated.emulator import BODIES

        protocol = options["protocol"]
        usual = {"fov": BODIES[protocol].fov, "fps": 7.0 if protocol == "wifi" else 2.6}
        made = _from_files(images, colors, usual | known)
        assumed = f" (what was not given is usual for {protocol}, not measured)"
    else:
        require("tqdm", "numpy", "gymnasium")
        config = Config(colors=colors, sequence=colors)
        with open_target(context, config, **options) as robot:
            from dntorch.drive.fit import hardware

            with hardware(robot.driver, robot.clock, config) as env:
                if distance is None:
                    known.setdefault("fov", robot.fov)
                made = measure(env, colors, distance, **known)
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


def measure(env: "HardwareEnv", colors: str, distance=None, **known) -> "Calibration":
    """Let the robot turn around and measure what it sees, with a bar of progress."""
    from dntorch.drive.look_around import calibrate_from, look_around

    with progress_bar(total=100, unit="%", desc="looking around") as bar:
        views = look_around(env, lambda share: bar.update(round(100 * share) - bar.n))
    return calibrate_from(views, colors, distance, **known)

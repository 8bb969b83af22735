"""Commands that take an agent out of this package, and check what came out."""

from functools import partial
from pathlib import Path

import click

from dntorch.commands.common import Computing
from dntorch.commands.kinds import NEW_FOLDER, OLD_FILE, OLD_FOLDER
from dntorch.extras import require
from dntorch.process import can_compile


@click.command(cls=Computing)
@click.argument("run", type=OLD_FOLDER)
@click.option("--to", "folder", type=NEW_FOLDER, required=True, help="Folder for the artefacts.")
@click.option(
    "--also",
    multiple=True,
    type=click.Choice(["aotinductor", "executorch"]),
    help="Formats besides TorchScript, torch.export and ONNX; may be given twice.",
)
@click.option(
    "--calibration",
    type=OLD_FILE,
    help="Of `dntorch robot calibrate`: for that robot.  [default: for the simulated one]",
)
def export(run: Path, folder: Path, also: tuple[str, ...], calibration: Path | None) -> None:
    """Export the agent of a RUN, to run without this package.

    The folder gets agent.ts, agent.pt2, agent.onnx, manifest.json, a golden record of the
    agent at work and verify.py, which compares them where there is no dntorch.
    """
    require("numpy", "onnx", "onnxscript", *(["executorch"] if "executorch" in also else []))
    if "aotinductor" in also and not can_compile():
        raise ValueError("--also=aotinductor needs a C++ compiler: install one or leave it out")
    from dntorch.export.artefacts import DEFAULT
    from dntorch.runs.export import export_run

    options = {}
    if calibration:
        from dntorch.drive.fit import fit
        from dntorch.robot.calibration import Calibration

        options = {"prepare": partial(fit, calibration=Calibration.load(calibration))}
    export_run(run, folder, (*DEFAULT, *also), **options)
    for file in sorted(folder.iterdir()):
        click.echo(f"{file.stat().st_size:>10,}  {file}")


@click.command(cls=Computing)
@click.argument("folder", type=OLD_FOLDER)
@click.option("--trust", is_flag=True, help="Load native code, too, since you know who made it.")
def verify(folder: Path, trust: bool) -> int:
    """Replay the golden record of an export through each artefact.

    In a fresh process that can't import this package. Exit code 1 when one fails, 2 where there
    is no export.
    """
    from dntorch.export import verify

    return 0 if verify(folder, trust) else 1

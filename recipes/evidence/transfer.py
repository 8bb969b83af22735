"""Values learned in simulation drive a robot whose camera was never simulated.

An emulated e-puck2 over its Wi-Fi protocol stands for the robot, in virtual time. Its camera is
mild (a slight cast, soft, noisy, 8 images/s) or hard (strong cast, dark, blurred, noisy, a view
of 25 degrees, 5 images/s that come 0.2 s late). It looks around once, amid blocks in another
order than any below, and calibrates itself. Then, in each of so many layouts, it has to execute
the rewarded sequence twice in a row: as the agent that was trained, and as the ONNX artefact
that was exported of it, going on learning, and without having calibrated itself. You will see a
line a layout, a table with Wilson's intervals, and two films in the layout of the paper's, with
learning off and on. Called again, it goes on where it was. Some 7 s a line on one core.

    dntorch learn --seed 1 --out runs/one
    python recipes/evidence/transfer.py runs/one --layouts 50 --processes 2 --out runs/transfer
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: processes side by side


from dntorch.drive.driving import Act, Onset, Trip, acting, perform, why_not
from dntorch.drive.fit import emulated, fit, load_agent
from dntorch.drive.look_around import calibrate_from, look_around
from dntorch.export.artefacts import checksum
from dntorch.files import write_json
from dntorch.paper.statistics import wilson
from dntorch.robot.calibration import Calibration
from dntorch.robot.emulated.camera import CAMERAS
from dntorch.runs.export import export_run
from dntorch.runs.train import CHECKPOINT
from dntorch.show.reel import Reel

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import run_agent

from dntorch.process import settle

ELSEWHERE = 1000
"""The layout in which the robot calibrates itself; those of the table begin at 0."""
DRIVERS = {"agent": False, "learning": True, "artefact": False, "uncalibrated": False}
"""What drives, and whether it goes on learning; uncalibrated, it knows the field of view alone."""


def prepare(run: Path, camera: str, folder: Path, exports: bool) -> None:
    """Calibrate the robot and export the agent for it, unless that was done."""
    file, lens = folder / f"{camera}.json", CAMERAS[camera]
    if not file.exists():
        _, config = load_agent(run)
        env, emulator, _ = emulated(config, ELSEWHERE, camera=lens)
        fov = lens.fov(emulator.world.body.fov)
        calibrate_from(look_around(env), config.colors, fov=fov).save(file)
    if exports and not (folder / camera / "manifest.json").exists():
        for_it = partial(fit, calibration=Calibration.load(file))
        export_run(run, folder / camera, ("onnx",), for_it)


def artefact(folder: Path) -> Act:
    """An exported agent as something that drives."""
    agent, nodes = run_agent.load(folder, "onnx"), "behaviors.satisfaction.u"
    agent.learn(False)
    half, report = agent.manifest["thresholds"][nodes], Onset(agent.state()[nodes].size)
    return lambda seen, reward: (agent.act(seen, reward), report(agent.state()[nodes] > half))


def drive(run: Path, folder: Path, job: tuple[str, str, int], film: Path | None = None) -> dict:
    """One layout: whether the sequence was executed twice in a row, or why not."""
    camera, driver, layout = job
    done = folder / "layouts" / f"{camera}-{driver}-{layout}.json"
    if done.exists() and not film:
        return json.loads(done.read_text())
    settle()
    trained, config = load_agent(run)
    known = Calibration.load(folder / f"{camera}.json")
    known = Calibration(fov=known.fov) if driver == "uncalibrated" else known
    env, emulator, seen = emulated(config, layout, known, camera=CAMERAS[camera])
    agent = fit(trained, config, known)
    agent.learn(DRIVERS[driver])
    act = artefact(folder / camera) if driver == "artefact" else acting(agent)
    trip, world = Trip.of(agent, config), emulator.world
    reel = Reel(agent, config, lambda: world.pose, world.view)
    perform(env, act, trip, steps=10_000, each=lambda step: film and reel.take(step, trip))
    if film:
        reel.write(film)
    world.close()
    result = trip.summary() | {"camera": camera, "driver": driver, "layout": layout}
    result["seen"] = "".join(config.colors[color] for color in seen)
    result["why_not"] = why_not(trip, result["seen"])
    write_json(done, result)
    return result


def row(results: list[dict], camera: str, driver: str) -> dict:
    """One line of the table."""
    mine = [r for r in results if (r["camera"], r["driver"]) == (camera, driver)]
    good = [r for r in mine if not r["why_not"]]
    behaviors = sum(len(r["found"]) for r in good)
    return {
        "camera": camera,
        "driver": driver,
        "succeeded": [len(good), len(mine)],
        "wilson": [round(edge, 3) for edge in wilson(len(good), len(mine))],
        "seconds_a_behavior": round(sum(r["seconds"] for r in good) / max(1, behaviors), 2),
        "failed": {r["layout"]: r["why_not"] for r in mine if r["why_not"]},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of dntorch learn")
    parser.add_argument("--layouts", type=int, default=50)
    parser.add_argument("--cameras", default="mild,hard")
    parser.add_argument("--drivers", default=",".join(DRIVERS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--no-films", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs/transfer"))
    given = parser.parse_args()
    cameras, drivers = given.cameras.split(","), given.drivers.split(",")
    (given.out / "layouts").mkdir(parents=True, exist_ok=True)
    mine, kept = {"checkpoint": checksum(given.run / CHECKPOINT)}, given.out / "run.json"
    if kept.exists() and json.loads(kept.read_text()) != mine:
        sys.exit(f"{given.out} holds layouts of another run than {given.run}: name another --out")
    write_json(kept, mine)
    for camera in cameras:
        prepare(given.run, camera, given.out, "artefact" in drivers)
    jobs = [(c, d, layout) for layout, c, d in product(range(given.layouts), cameras, drivers)]
    results = []
    with ProcessPoolExecutor(given.processes, get_context("spawn")) as pool:
        for job, one in zip(jobs, pool.map(partial(drive, given.run, given.out), jobs)):
            results.append(one)
            print(*job, one["seconds"], "s", one["found"], one["why_not"] or "ok", flush=True)
    table = [row(results, *cell) for cell in product(cameras, drivers)]
    print(*table, sep="\n")
    write_json(given.out / "table.json", {"rows": table})
    for driver in [] if given.no_films else {"agent", "learning"} & {*drivers}:
        film = given.out / f"{cameras[-1]}-{driver}.webm"
        drive(given.run, given.out, (cameras[-1], driver, 0), film)
        print(film)


if __name__ == "__main__":
    main()

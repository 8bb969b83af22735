"""Values learned in simulation drive a robot whose camera was never simulated.

An emulated e-puck2 over its Wi-Fi protocol stands for the robot, in virtual time. Its camera is
mild (a slight cast, soft, noisy, 8 images/s) or hard (strong cast, dark, blurred, noisy, a view
of 25 degrees, 5 images/s that come 0.2 s late). It looks around once, amid blocks in another
order than any below, and calibrates itself. Then, in each of so many layouts, it has to execute
the rewarded sequence twice in a row: as the agent that was trained, and as the ONNX artefact
that was exported of it. You will see a line a layout, a table with Wilson's intervals, and two
films in the layout of the paper's, with learning off and on. Some 15 s a layout on one core.

    dntorch learn --seed 1 --out runs/one
    python recipes/transfer.py runs/one --layouts 50 --processes 2 --out runs/transfer
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

import torch
from scipy.stats import binomtest

from dntorch.envs.emulated import emulate
from dntorch.envs.hardware import HardwareEnv
from dntorch.envs.task import NOTHING, SequenceTask
from dntorch.experiments import robot
from dntorch.experiments.checkpoint import write_atomically
from dntorch.experiments.look_around import calibrate_from, look_around
from dntorch.experiments.reel import Reel
from dntorch.export import export_run
from dntorch.robot.calibration import Calibration
from dntorch.robot.camera import CAMERAS
from dntorch.robot.clock import VirtualClock
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulator import Emulator
from dntorch.robot.servers import MemoryServer

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import run_agent

ELSEWHERE = 1000
"""The layout in which the robot calibrates itself; those of the table begin at 0."""
DRIVERS = {"agent": False, "learning": True, "artefact": False}
"""What drives, and whether it goes on learning."""


def stand(camera: str, layout: int, config, known=None) -> tuple[HardwareEnv, Emulator, list[int]]:
    """A robot amid its blocks, and what the world sees it find."""
    clock, server, seen = VirtualClock(), MemoryServer(), []
    emulator = emulate(
        server, clock, camera=CAMERAS[camera], layout=layout,
        world={"colors": config.colors, "sequence": config.sequence, "dt": config.dt},
        on_step=lambda i: seen.append(int(i["found"])) if i["found"] != NOTHING else None,
    )  # fmt: skip
    emulator.start()
    env = robot.hardware(Driver(server.transport(), Wifi(), clock), clock, config, known)
    return env, emulator, seen


def prepare(run: Path, camera: str, folder: Path) -> None:
    """Calibrate the robot and export the agent for it, unless that was done."""
    file = folder / f"{camera}.json"
    if not file.exists():
        _, config = robot.load_agent(run)
        env, emulator, _ = stand(camera, ELSEWHERE, config)
        fov = CAMERAS[camera].fov(emulator.world.body.fov)
        calibrate_from(look_around(env), config.colors, fov=fov).save(file)
    if not (folder / camera / "manifest.json").exists():
        fit = partial(robot.fit, calibration=Calibration.load(file))
        export_run(run, folder / camera, ("onnx",), fit)


def artefact(folder: Path) -> robot.Act:
    """An exported agent as something that drives."""
    agent, nodes = run_agent.load(folder, "onnx"), "behaviors.satisfaction.u"
    agent.learn(False)
    came_on = robot.Onset(agent.manifest["decisions"][nodes])
    return lambda image, reward: (agent.act(image, reward), came_on(agent.state()[nodes]))


def drive(run: Path, folder: Path, job: tuple[str, str, int], film: Path | None = None) -> dict:
    """One layout: whether the sequence was executed twice in a row, or why not."""
    camera, driver, layout = job
    done = folder / "layouts" / f"{camera}-{driver}-{layout}.json"
    if done.exists() and not film:
        return json.loads(done.read_text())
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    agent, config = robot.load_agent(run)
    known = Calibration.load(folder / f"{camera}.json")
    env, emulator, seen = stand(camera, layout, config, known)
    agent = robot.fit(agent, config, known)
    agent.learn(DRIVERS[driver])
    act = artefact(folder / camera) if driver == "artefact" else robot.acting(agent)
    log, world = robot.Log(config), emulator.world
    reel = Reel(agent, config, lambda: world.pose, world.view)
    robot.perform(env, act, log, steps=10_000, each=lambda step: film and reel.take(step, log))
    if film:
        reel.write(film)
    world.close()
    result = log.summary() | {"camera": camera, "driver": driver, "layout": layout}
    result["seen"] = "".join(config.colors[color] for color in seen)
    result["why_not"] = why_not(log, result["seen"])
    text = json.dumps(result, indent=1)
    write_atomically(done, lambda file: file.write(text.encode()))
    return result


def why_not(log: robot.Log, seen: str) -> str:
    """What kept it from executing the sequence twice in a row, truly; "" if nothing did."""
    both = min(len(seen), len(log.letters))
    if seen[:both] != log.letters[:both] or abs(len(seen) - len(log.letters)) > 1:
        return f"reported {log.letters}, the world saw {seen}"
    if len(log.completed) < 2:
        return f"{log.ending} after {log.letters or 'no behaviour'}"
    at = [step for step, _ in log.found]
    between = at.index(log.completed[1]) - at.index(log.completed[0])
    period = SequenceTask(log.config.sequence, log.config.colors).period
    return "" if between == period else f"a detour: {log.letters}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of dntorch learn")
    parser.add_argument("--layouts", type=int, default=50)
    parser.add_argument("--cameras", default="mild,hard")
    parser.add_argument("--drivers", default="agent,artefact", help=f"of {','.join(DRIVERS)}")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--films", action="store_true", help="of layout 0")
    parser.add_argument("--out", type=Path, default=Path("runs/transfer"))
    given = parser.parse_args()
    (given.out / "layouts").mkdir(parents=True, exist_ok=True)
    cells = list(product(given.cameras.split(","), given.drivers.split(",")))
    for camera in given.cameras.split(","):
        prepare(given.run, camera, given.out)
    jobs = [(*cell, layout) for layout, cell in product(range(given.layouts), cells)]
    results = []
    with ProcessPoolExecutor(given.processes, get_context("spawn")) as pool:
        for job, one in zip(jobs, pool.map(partial(drive, given.run, given.out), jobs)):
            results.append(one)
            print(*job, one["seconds"], "s", one["found"], one["why_not"] or "ok", flush=True)
    table = []
    for camera, driver in cells:
        mine = [r for r in results if (r["camera"], r["driver"]) == (camera, driver)]
        good = [r for r in mine if not r["why_not"]]
        interval = binomtest(len(good), len(mine)).proportion_ci(method="wilson")
        seconds = [r["seconds"] / max(1, len(r["found"])) for r in good]
        table.append({
            "camera": camera, "driver": driver, "succeeded": [len(good), len(mine)],
            "wilson": [round(float(edge), 3) for edge in interval],
            "seconds_a_behavior": round(sum(seconds) / max(1, len(seconds)), 2),
            "failed": {r["layout"]: r["why_not"] for r in mine if r["why_not"]},
        })  # fmt: skip
        print(table[-1])
    text = json.dumps(table, indent=1)
    write_atomically(given.out / "table.json", lambda file: file.write(text.encode()))
    if given.films:
        for driver in ("agent", "learning"):
            film = given.out / f"{given.cameras.split(',')[-1]}-{driver}.webm"
            print(drive(given.run, given.out, (given.cameras.split(",")[-1], driver, 0), film))


if __name__ == "__main__":
    main()

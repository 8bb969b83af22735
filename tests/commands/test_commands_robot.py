"""The commands about robots: an emulator in virtual time, and one end to end over TCP."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from robot_worlds import Turntable
from waiting import wait

pytest.importorskip("pybullet")

from dntorch import files
from dntorch.cli import main
from dntorch.commands.robot import _enter
from dntorch.drive.fit import load_agent
from dntorch.robot.calibration import Calibration
from dntorch.robot.emulated.emulator import Emulator
from dntorch.robot.emulated.firmware import WifiFirmware
from dntorch.robot.emulated.servers import TcpServer
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config

CLIENT = Path(__file__).parents[1] / "robot" / "third_party_client.py"
COMMAND = [sys.executable, "-m", "dntorch.cli"]
#: As where a robot is, but no simulation can be installed.
WITHOUT_PYBULLET = [
    sys.executable, "-c",
    "import sys; sys.modules['pybullet'] = None; from dntorch.cli import main; main()",
]  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A run that knows the sequence G-B-G, and what its robot's camera is like."""
    folder = tmp_path_factory.mktemp("run")
    config = Config(colors="GB", sequence="GBG")
    agent = build_agent(config)
    agent.weights.copy_(0.5 * (1 - torch.eye(2)))
    content = {"config": vars(config), "agent": agent.snapshot()}
    files.save(folder / "checkpoint.pt", content)
    Calibration(fov=0.656, fps=8.0).save(folder / "robot.json")
    return folder


@pytest.fixture
def dntorch(monkeypatch, capsys):
    """Run a command in this process; its exit code, what it printed, and its errors."""

    def call(*arguments) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["dntorch", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit:
            main()
        code = exit.value.code
        return (0 if code is None else code), *capsys.readouterr()

    return call


def run_virtually(trained: Path, *more) -> list:
    return ["robot", "run", trained, "--virtual", "--camera", "mild",
            "--calibration", trained / "robot.json", *more]  # fmt: skip


def content_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_it_executes_its_sequence_and_keeps_what_it_learns(dntorch, trained, tmp_path):
    before, out = content_of(trained), tmp_path / "a"
    code, printed, _ = dntorch(*run_virtually(trained, "--learn", "--out", out))
    assert code == 0, printed
    report = json.loads((out / "report.json").read_text())
    assert report["found"] == report["seen_by_the_world"] and report["found"].endswith("GBGBG")
    assert len(report["completed_at_step"]) == 2 and report["connections"] == 1
    assert report["late_ms"]["max"] == 0 and 7.5 < report["images_per_second"] < 8.5
    assert f"report: {out / 'report.json'}" in printed and "late: median" in printed
    assert content_of(trained) == before
    (old, _), (new, config) = load_agent(trained), load_agent(out)
    assert config.sequence == "GBG" and not torch.equal(old.weights, new.weights)
    # Nothing is written over, and what was learned is a run that another one begins with.
    code, _, error = dntorch(*run_virtually(trained, "--out", out))
    assert code == 2 and "holds a run already" in error
    again = run_virtually(out, "--steps", 2, "--out", tmp_path / "b", "--learn")
    again[again.index("--calibration") + 1] = trained / "robot.json"
    assert dntorch(*again)[0] == 1
    assert torch.equal(load_agent(tmp_path / "b")[0].weights, new.weights)


def test_an_end_before_its_time_is_exit_code_1(dntorch, trained):
    code, printed, _ = dntorch(*run_virtually(trained, "--steps", 20, "--film"))
    assert code == 1 and "ended: 20 steps were taken\nfound: nothing" in printed
    kept = content_of(trained / "robot-1")
    assert sorted(kept) == ["calibration.json", "film.webm", "report.json"]
    assert len(kept["film.webm"]) > 10_000


def test_a_lost_link_ends_it_with_what_was_learned(dntorch, trained, tmp_path):
    arguments = run_virtually(trained, "--learn", "--fault", "reset=0.2", "--out", tmp_path / "a")
    code, _, error = dntorch(*arguments)
    assert code == 2 and "no link to the robot" in error
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    assert report["ending"].startswith("LinkLost") and report["faults"]["reset"] == 1
    load_agent(tmp_path / "a")
    code, printed, _ = dntorch(*arguments[:-1], tmp_path / "b", "--reconnect", "--steps", 200)
    report = json.loads((tmp_path / "b" / "report.json").read_text())
    assert code == 1 and report["connections"] > 1 and report["steps"] == 200, printed


def test_without_a_calibration_it_looks_around_first(dntorch, tmp_path):
    config = Config()
    content = {"config": vars(config), "agent": build_agent(config).snapshot()}
    files.save(tmp_path / "checkpoint.pt", content)
    arguments = ["robot", "run", tmp_path, "--virtual", "--camera", "hard", "--steps", 1]
    assert dntorch(*arguments, "--out", tmp_path / "a")[0] == 1
    made = Calibration.load(tmp_path / "a" / "calibration.json")
    red, green, blue = made.gains
    assert red < 0.75 * green < 0.75 * blue  # it has too much of red, too little of blue
    assert abs(made.fps - 5) < 0.2 and abs(made.axle - 0.052) < 0.001
    assert abs(made.fov - 0.432) < 0.001
    for letter, hue in {"R": 0, "G": 120, "B": 240, "Y": 60}.items():
        assert abs((made.hues[letter] - hue + 180) % 360 - 180) < 8


def test_enter_is_heard_once_and_its_end_is_no_reward(monkeypatch):
    ours, theirs = os.pipe()
    with os.fdopen(ours) as stdin, os.fdopen(theirs, "w", buffering=1) as keys:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert not _enter()
        keys.write("\n")
        assert _enter() and not _enter()
        keys.close()
        assert not _enter() and not _enter()


# ---------------------------------------------------------------- calibrate


def test_a_robot_measures_itself(dntorch, tmp_path):
    file = tmp_path / "robot.json"
    arguments = ["robot", "calibrate", "--virtual", "--camera", "mild", "--to", file]
    code, printed, _ = dntorch(*arguments, "--distance", 0.36)
    made = Calibration.load(file)
    assert code == 0 and f"calibration: {file}" in printed
    assert abs(made.fov - 0.656) < 0.04 and not made.mirror
    assert abs(made.fps - 8) < 0.2 and abs(made.axle - 0.052) < 0.001
    assert made.gains[0] < made.gains[1] < made.gains[2]  # MILD has (1.1, 1.0, 0.9)


def test_images_calibrate_colours(dntorch, tmp_path):
    import cv2

    images = []
    for k, bgr in enumerate(((0, 0, 200), (0, 190, 30), (180, 0, 10), (0, 190, 200))):
        image = np.full((60, 80, 3), 120, np.uint8)
        image[20:50, 20:60] = bgr
        images.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(images[-1]), image)
    file = tmp_path / "robot.json"
    code, _, error = dntorch("robot", "calibrate", *images, "--to", file, "--fov", 0.7, "--mirror")
    made = Calibration.load(file)
    assert code == 0, error
    assert made.fov == 0.7 and made.mirror and sorted(made.hues) == ["B", "G", "R", "Y"]
    code, printed, _ = dntorch("robot", "calibrate", *images, "--to", file)
    assert code == 0 and "(replaced)" in printed


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["robot", "run", "{run}", "--connect", "10.0.0.1"], ["--connect", "tcp://HOST"]),
        (["robot", "run", "{run}", "--connect", "tcp://127.0.0.1:9"], ["--connect", "is it on"]),
        (["robot", "run", "{run}", "--connect", "serial:///no"], ["--connect", "/no"]),
        (["robot", "run", "{run}", "--connect", "tcp://x", "--camera", "hard"],
         ["--camera", "leave --camera out"]),
        (["robot", "run", "{run}", "--connect", "tcp://x", "--fault", "drop=1"], ["--fault"]),
        (["robot", "run", "no/such/run"], ["no/such/run", "name a folder"]),
        (["robot", "run", "{nodes}"], ["world='nodes'", "train with --world epuck"]),
        (["robot", "run", "{run}", "--speed-cap", "9"], ["--speed-cap=9", "at most 6.28"]),
        (["robot", "run", "{run}", "--calibration", "{run}/none"], ["none"]),
        (["robot", "run", "{run}", "--calibration", "{run}/checkpoint.pt"], ["no calibration"]),
        (["robot", "run", "{run}", "--out", "{run}/robot.json/x"], ["--out", "name another"]),
        (["robot", "run", "{run}", "--fault", "fire=1"], ["--fault=fire=1", "stall"]),
        (["robot", "run", "{run}", "--fault", "drop=2", "--virtual"],
         ["--fault=drop=2", "from 0 to 1"]),
        (["robot", "calibrate"], ["--to"]),
        (["robot", "calibrate", "{run}/robot.json", "--to", "{run}/x"], ["IMAGES", "leave it out"]),
        (["robot", "calibrate", "--colors", "RX", "--to", "{run}/x"], ["RX", "ROYGCBVM"]),
        (["emulate", "--protocol", "sercom", "--pacing", "webots"], ["webots", "sercom"]),
        (["robot", "calibrate", "{run}/robot.json", "--to", "{run}/x", "--distance", "1"],
         ["--distance", "leave --distance out"]),
        (["robot", "calibrate", "{run}/robot.json", "--to", "{run}/x", "--connect", "tcp://x"],
         ["--connect", "leave --connect out"]),
        (["emulate", "--pty", "--port", "5"], ["--port", "leave --port out"]),
        (["emulate", "--pty", "--host", "127.0.0.1"], ["--host", "leave --host out"]),
        (["emulate", "--host", "192.0.2.1"], ["--host=192.0.2.1", "name another"]),
        (["emulate", "--colors", "RX"], ["RX", "ROYGCBVM"]),
        (["emulate", "--colors", "GBC", "--missing", "V"], ["missing='V'", "different letters"]),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(arguments, names, dntorch, trained, tmp_path):
    config = Config(world="nodes")
    content = {"config": vars(config), "agent": build_agent(config).snapshot()}
    files.save(tmp_path / "checkpoint.pt", content)
    given = [text.format(run=trained, nodes=tmp_path) for text in arguments]
    code, _, error = dntorch(*given)
    assert code == 2
    assert len(error.strip().splitlines()) == 1, error
    for name in names:
        assert name in error


def test_the_served_ring_has_the_colors_that_were_named(dntorch, monkeypatch):
    rings = []
    module = sys.modules["dntorch.commands.emulate"]
    monkeypatch.setattr(module, "_watch", lambda emulator: rings.append(emulator.world))
    for given in ([], ["--missing", "G"]):
        code, printed, _ = dntorch("emulate", "--colors", "OGV", "--camera", "ideal", *given)
        assert code == 0 and "steps, faults: none" in printed
    full, missing = rings
    assert full.colors == missing.colors == "OGV"
    assert sorted(full.layout) == [0] * 4 + [1] * 4 + [2] * 4
    assert sorted(missing.layout) == [0] * 6 + [2] * 6


# ---------------------------------------------------------------- processes of their own


def test_the_served_emulator_keeps_the_last_speed_of_a_foreign_client(tmp_path):
    shown = tmp_path / "shown"
    with open(shown, "w") as errors, subprocess.Popen(
        [*COMMAND, "emulate", "--camera", "ideal", "--port", "0"],
        stdout=subprocess.PIPE, stderr=errors, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # as in the background
    ) as emulator:  # fmt: skip
        try:
            kind, _, address = emulator.stdout.readline().split()
            host, port = address.removeprefix("tcp://").split(":")
            client = [sys.executable, "-S", str(CLIENT), host, port]
            done = subprocess.run(client, capture_output=True, text=True, timeout=60)
            with subprocess.Popen([*client, "--hang"], stdout=subprocess.DEVNULL) as hanging:
                text = "client: connected, motors: -80 80 steps/s"
                drove = wait(lambda: text in shown.read_text())
                hanging.kill()
            text = "client: none, motors: -80 80 steps/s"
            assert drove and wait(lambda: text in shown.read_text())
        finally:
            emulator.send_signal(signal.SIGINT)
        printed, _ = emulator.communicate(timeout=30)
    assert kind == "wifi" and done.returncode == 0, done.stderr
    left, right = json.loads(done.stdout)["turned"]
    assert abs(left + right) <= 2 and right > 20
    assert emulator.returncode == 0 and "Traceback" not in shown.read_text()
    assert "steps, faults" in printed


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 130), (signal.SIGHUP, 129), (signal.SIGQUIT, 131)]
)
def test_a_request_to_end_stops_the_robot_and_keeps_what_was_learned(
    number, code, trained, tmp_path
):
    world, server, out = Turntable(), TcpServer(), tmp_path / "out"
    with Emulator(world, server, WifiFirmware()) as emulator:
        options = ["--learn", "--calibration", str(trained / "robot.json"), "--out", str(out)]
        command = ["robot", "run", str(trained), "--connect", server.address, *options]
        with subprocess.Popen(
            [*WITHOUT_PYBULLET, *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process:
            assert wait(lambda: any(emulator.speeds)), "it never drove"
            process.send_signal(number)
            printed, _ = process.communicate(timeout=60)
        assert wait(lambda: emulator.speeds == (0, 0), 5.0)
    assert process.returncode in (code, 130)
    assert re.search("ended: (KeyboardInterrupt|SystemExit)", printed), printed
    assert "late: median" in printed
    load_agent(out)

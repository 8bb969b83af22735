"""An exported agent: the same numbers, in other processes, and no motion from bad input."""

import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from dntorch.envs import HardwareEnv, RingEnv
from dntorch.export import replay
from dntorch.noise import Exploration
from dntorch.robot.calibration import Calibration
from dntorch.robot.clock import VirtualClock
from dntorch.robot.dialects import Wifi
from dntorch.robot.driver import Driver
from dntorch.robot.emulated.emulator import WIFI_BODY, Emulator
from dntorch.robot.emulated.firmware import WifiFirmware
from dntorch.robot.emulated.servers import TcpServer
from dntorch.robot.transports import Tcp
from dntorch.runs.config import Config
from dntorch.runs.run import Trial

EXAMPLES = Path(__file__).parents[2] / "examples"
RUNNER = EXAMPLES / "run_agent.py"
WEIGHTS, COUNTS = "learner.values.weights", ["decisions", "failures", "ignored"]
HALVES = ["behaviors.intention.u", "behaviors.satisfaction.u"]


#: What `dntorch learn --seed 1` had learned in the end, [state][action], in the order RGBY.
LEARNED = [
    [0.0, 1.0056953430175781, 0.004263313952833414, 0.0029460580553859472],
    [0.003377665067091584, 0.0, 0.4442216157913208, 0.0008555123349651694],
    [0.004567219875752926, 0.001972167519852519, 0.0, 0.6618044376373291],
    [0.869457483291626, 0.0038175585214048624, 0.0008779268246144056, 0.0],
]


def load_example(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


runner, epuck = load_example(RUNNER), load_example(EXAMPLES / "epuck.py")


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A run with the values of one that learned the sequence G-B-Y-R-G."""
    trial = Trial(Config(world="ring", steps=100, explore=0, seed=1))
    trial.agent.weights.copy_(torch.tensor(LEARNED).t())
    folder = tmp_path_factory.mktemp("run")
    trial.save(folder / "checkpoint.pt")
    trial.close()
    return folder


@pytest.fixture(scope="module")
def exported(trained, tmp_path_factory) -> Path:
    """By the real command, in a process where a warning is an error."""
    folder = tmp_path_factory.mktemp("run") / "export"
    command = [sys.executable, "-m", "dntorch.cli", "export", str(trained), "--to", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    assert {Path(line.split()[-1]) for line in done.stdout.splitlines()} == set(folder.iterdir())
    return folder


@pytest.fixture(scope="module")
def manifest(exported) -> dict:
    return json.loads((exported / "manifest.json").read_text())


@pytest.fixture(scope="module")
def golden(exported) -> dict[str, np.ndarray]:
    with np.load(exported / "golden.npz") as file:
        return dict(file)


def part_of(exported: Path, folder: Path, *artefacts: str) -> Path:
    """A copy of an export with these artefacts only."""
    for name in ("manifest.json", "golden.npz", *artefacts):
        shutil.copy(exported / name, folder / name)
    edit(folder, lambda m: m.update(files={k: m["files"][k] for k in artefacts}))
    return folder


def edit(folder: Path, change) -> None:
    content = json.loads((folder / "manifest.json").read_text())
    change(content)
    (folder / "manifest.json").write_text(json.dumps(content))


def sign(folder: Path) -> None:
    """Make checksums those of the files, so that only the numbers can tell."""

    def update(content: dict) -> None:
        for name, entry in content["files"].items():
            entry["sha256"] = hashlib.sha256((folder / name).read_bytes()).hexdigest()

    edit(folder, update)


# ---------------------------------------------------------------- the record and the manifest


def test_the_record_holds_onsets_rewards_both_switches_and_numbers_to_ignore(golden) -> None:
    decisions = golden["run/next.decisions"]
    assert len(decisions) >= 800
    assert decisions[-1] >= 4  # onsets of CoS, with transitions between them
    assert (golden["run/reward"] > 0).any()
    snapshots = set(golden["pairs/step"].tolist())
    assert snapshots >= set(range(0, len(decisions), 50)) and -1 in snapshots
    assert golden["run/noise"].any(1).any() and not golden["run/noise"].any(1).all()
    weights = golden["run/next." + WEIGHTS]
    learning = golden["run/learner.values.learning"] > 0
    assert np.abs(weights[learning][-1] - weights[0]).max() > 1e-2
    assert not learning[-1] and np.ptp(weights[~learning], axis=0).max() == 0
    assert np.isnan(golden["run/reward"]).sum() == np.isnan(golden["run/noise"]).sum() == 1
    assert golden["run/next.ignored"][-1] == 2
    assert np.isnan(golden["pairs/reward"]).any() and np.isnan(golden["pairs/noise"]).any()


def test_the_manifest_says_what_a_robot_needs(manifest, exported) -> None:
    image, reward, noise = manifest["inputs"]
    assert image == {"name": "image", "shape": [39, 52, 3], "dtype": "uint8"}
    assert (reward["shape"], noise["shape"]) == ([], [4])
    assert manifest["outputs"] == [{"name": "action", "shape": [2], "dtype": "float32"}]
    assert manifest["units"]["image"] == "RGB 0-255, row 0 at the top"
    assert manifest["units"]["action"] == "rad/s, left wheel first"
    assert manifest["dt"] == 1 / 32 and manifest["max_speed"] == 1.26
    assert [c["letter"] for c in manifest["colors"]] == list("RGBY")
    assert manifest["colors"][1] == {"letter": "G", "name": "green", "hue": 120.0}
    state = {port["name"]: port for port in manifest["state"]}
    assert state["behaviors.intention.u"]["rest"] == -5.0
    assert [name for name, port in state.items() if port["lasting"]] == [WEIGHTS, *COUNTS]
    assert np.array_equal(np.array(state[WEIGHTS]["rest"], np.float32).T, np.float32(LEARNED))
    assert [port["rest"] for port in manifest["switches"]] == [1.0]
    assert manifest["thresholds"] == dict.fromkeys(HALVES, 0.0)
    assert manifest["exploration"] == {"amplitude": 10.0, "seed": 1}
    source = manifest["source"]
    assert source["config"]["sequence"] == "GBYRG" and len(source["checkpoint_sha256"]) == 64
    for name, entry in manifest["files"].items():
        content = (exported / name).read_bytes()
        assert entry["bytes"] == len(content)
        assert entry["sha256"] == hashlib.sha256(content).hexdigest()


# ---------------------------------------------------------------- verify

WITHOUT_DNTORCH = """
import runpy, sys
sys.argv = ["verify.py", sys.argv[1]]
try:
    runpy.run_path(sys.argv[1] + "/verify.py", run_name="__main__")
except SystemExit as exit:
    code = exit.code
assert sys.modules["dntorch"] is None
assert not [name for name in sys.modules if name.startswith("dntorch.")]
sys.exit(code)
"""


def test_all_artefacts_pass_in_a_process_without_dntorch(exported) -> None:
    command = [sys.executable, "-c", WITHOUT_DNTORCH, str(exported)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("agent.ts", "agent.pt2", "agent.onnx"):
        assert f"{name}: ok" in done.stdout
    assert "steps from recorded states, 902 running freely" in done.stdout


def test_verify_is_a_command_with_an_exit_code(exported, tmp_path) -> None:
    part_of(exported, tmp_path, "agent.onnx")
    edit(tmp_path, lambda m: m["state"][0].update(rest=-4.999))
    command = [sys.executable, "-m", "dntorch.cli", "verify", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 1, done.stderr
    assert "agent.onnx: FAILED" in done.stdout and "sensorimotor.perception.u" in done.stdout


def change_script(path: Path, find) -> None:
    module = torch.jit.load(path)
    find(module.structure).view(-1)[5] += 1e-3
    torch.jit.save(module, path)


def change_program(path: Path) -> None:
    program = torch.export.load(path)
    (name,) = [key for key in program.constants if key.endswith("heading.kernel_0")]
    program.constants[name].view(-1)[5] += 1e-3
    torch.export.save(program, path)


def change_onnx(path: Path) -> None:
    model = onnx.load(path)
    big = [x for x in model.graph.initializer if list(x.dims) == [52, 52]]
    values = onnx.numpy_helper.to_array(big[0]).copy()
    values.flat[5] += 1e-3
    big[0].CopyFrom(onnx.numpy_helper.from_array(values, big[0].name))
    onnx.save(model, path)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("agent.ts", lambda p: change_script(p, lambda s: s.learner.values.weights)),
        ("agent.ts", lambda p: change_script(p, lambda s: s.sensorimotor.perception.kernel_1)),
        ("agent.ts", lambda p: change_script(p, lambda s: s.sensorimotor.hue_bias)),
        ("agent.pt2", change_program),
        ("agent.onnx", change_onnx),
    ],
    ids=["learned value", "kernel", "hue bias", "torch.export", "onnx"],
)
def test_one_weight_changed_by_a_thousandth_fails(name, change, exported, tmp_path, capsys) -> None:
    part_of(exported, tmp_path, name)
    change(tmp_path / name)
    assert not replay.verify(tmp_path)
    assert "with another checksum" in capsys.readouterr().out
    sign(tmp_path)
    assert not replay.verify(tmp_path)
    printed = capsys.readouterr().out
    assert "checksum" not in printed and "FAILED" in printed


@pytest.mark.parametrize("name", ["agent.ts", "agent.pt2", "agent.onnx", "golden.npz"])
def test_a_truncated_file_fails_with_its_name(name, exported, tmp_path, capsys) -> None:
    part_of(exported, tmp_path, *({name} - {"golden.npz"} or {"agent.onnx"}))
    os.truncate(tmp_path / name, (tmp_path / name).stat().st_size // 2)
    if name == "golden.npz":
        with pytest.raises(replay.Unfit, match=r"golden.npz is damaged .*: export again"):
            replay.verify(tmp_path)
        return
    for signed in (False, True):
        if signed:
            sign(tmp_path)
        assert not replay.verify(tmp_path)
        assert f"{name}: FAILED: " in capsys.readouterr().out


@pytest.mark.parametrize("name", ["agent.ts", "agent.onnx"])
def test_a_manifest_of_another_agent_fails(name, exported, tmp_path, capsys) -> None:
    part_of(exported, tmp_path, name)
    edit(tmp_path, lambda m: m["state"].pop(2))
    assert not replay.verify(tmp_path)
    assert "FAILED" in capsys.readouterr().out


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": 7}', '{"format": 3}'])
def test_a_damaged_manifest_is_named(content, tmp_path) -> None:
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(replay.Unfit, match=r"manifest.json .*export again"):
        replay.verify(tmp_path)


@pytest.mark.parametrize("number", [1, 2])
def test_an_export_of_an_older_form_is_refused_in_one_sentence(number, exported, tmp_path) -> None:
    part_of(exported, tmp_path, "agent.onnx")

    def older(content: dict) -> None:
        content["format"] = number
        content["decisions"] = content.pop("thresholds")

    edit(tmp_path, older)
    for command in (["-m", "dntorch.cli", "verify"], [str(RUNNER), "--robot=r.py:R"]):
        done = subprocess.run(
            [sys.executable, *command, str(tmp_path)], capture_output=True, text=True, timeout=200
        )
        assert done.returncode == 1
        assert f"manifest.json is of format {number}, not 3: export again" in done.stderr
        assert done.stderr.count("\n") == 1


# ---------------------------------------------------------------- bad input

IMAGE = np.zeros((39, 52, 3), np.uint8)


def wrong(**changes):
    good = {
        "image": torch.from_numpy(IMAGE),
        "reward": torch.zeros(()),
        "noise": torch.zeros(4),
    }
    return tuple((good | changes).values())


@pytest.mark.parametrize(
    ("inputs", "says"),
    [
        (wrong(image=torch.zeros(40, 52, 3, dtype=torch.uint8)), r"input image .*\[40, 52"),
        (wrong(image=torch.zeros(39, 52, 3)), "input image .*dtype"),
        (wrong(reward=torch.zeros(1)), "input reward of shape"),
        (wrong(noise=torch.zeros(4, dtype=torch.float64)), "input noise .*dtype"),
    ],
)
def test_torchscript_refuses_bad_input_and_stays_as_it_was(exported, inputs, says) -> None:
    agent = torch.jit.load(exported / "agent.ts")
    before = agent.get_state()
    with pytest.raises(Exception, match=says):
        agent(*inputs)
    after = agent.get_state()
    assert all(torch.equal(before[name], after[name]) for name in before)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        (WEIGHTS, torch.full((4, 4), torch.nan), "is not finite"),
        (WEIGHTS, torch.zeros(3, 3), "of shape"),
        (WEIGHTS, torch.zeros(4, 4, dtype=torch.float64), "dtype"),
        ("extra", torch.zeros(4), "names"),
    ],
)
def test_torchscript_refuses_a_bad_state_as_a_whole(exported, name, value, says) -> None:
    agent = torch.jit.load(exported / "agent.ts")
    before = agent.get_state()
    changed = {key: tensor + 1 for key, tensor in before.items()}
    with pytest.raises(Exception, match=says):
        agent.set_state(changed | {name: value})
    assert all(torch.equal(before[key], tensor) for key, tensor in agent.get_state().items())


def test_torchscript_has_the_methods_of_the_agent(exported) -> None:
    agent = torch.jit.load(exported / "agent.ts")
    rest = agent.get_state()
    agent.set_state({key: tensor + 1 for key, tensor in rest.items()})
    agent.reset()
    for key, tensor in agent.get_state().items():
        assert torch.equal(tensor, rest[key] + (key in (WEIGHTS, *COUNTS))), key
    agent.learn(False)
    assert not agent.structure.learner.values.learning
    agent.forget()
    assert not any(agent.get_state()[name].any() for name in (WEIGHTS, *COUNTS))
    assert agent.dt == 1 / 32


def stateless(exported, name: str, manifest):
    artefact = replay.LOADERS[{"agent.pt2": "export", "agent.onnx": "onnx"}[name]]
    return artefact(exported / name, manifest)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.zeros((40, 52, 3), np.uint8), "image"),
        (
            np.zeros((39, 52, 3)),
            "dtype mismatch! Expected: Byte|input data type.*expected: .tensor.uint8",
        ),
    ],
    ids=["size", "dtype"],
)
@pytest.mark.parametrize("name", ["agent.pt2", "agent.onnx"])
def test_a_function_refuses_another_image(name, image, says, exported, manifest) -> None:
    agent = stateless(exported, name, manifest)
    arrays = [image, np.array(0, np.float32), np.zeros(4, np.float32), np.array(1, np.float32)]
    with pytest.raises(Exception, match=says):
        agent.call([*arrays, *agent.held.values()])


# ---------------------------------------------------------------- the runner of one file


class Timeless:
    """A clock for tests: sleeping takes no time."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Simulated:
    """The e-puck of the simulated world, behind the runner's interface."""

    def __init__(self, **options) -> None:
        self.env = RingEnv(**options)
        self.observation = self.env.reset(seed=1)[0]
        self.found, self.rewarded, self.now = [], 0, 0.0

    def observe(self) -> dict[str, np.ndarray]:
        return self.observation

    def drive(self, left: float, right: float) -> None:
        self.observation, self.now, _, _, info = self.env.step(np.array([left, right]))
        self.rewarded += bool(info["completed"])
        if info["found"] >= 0:
            self.found.append("RGBY"[info["found"]])

    def reward(self) -> float:
        return self.now


@pytest.mark.parametrize("runtime", ["onnx", "torchscript"])
def test_the_runner_completes_the_sequence_twice_in_the_simulated_world(exported, runtime) -> None:
    agent, robot = runner.load(exported, runtime), Simulated()
    learned = agent.state()[WEIGHTS].copy()
    for _ in range(30):
        runner.run(agent, robot, 100, clock=Timeless())
        if robot.rewarded == 2:
            break
    robot.env.close()
    assert robot.rewarded == 2, robot.found
    assert "GBYRGBYRG" in "".join(robot.found)
    assert np.abs(agent.state()[WEIGHTS] - learned).max() > 1e-2  # it kept learning


def test_the_runner_completes_the_sequence_twice_on_an_emulated_robot_over_tcp(exported) -> None:
    """Through the robot's protocol: the agent at one end, all that is true at the other."""
    true = {"found": [], "completed": 0, "new": False}

    def see(info) -> None:
        true["found"] += ["RGBY"[info["found"]]] if info["found"] >= 0 else []
        true["completed"] += bool(info["completed"])
        true["new"] |= bool(info["completed"])

    def press() -> bool:
        """Somebody watches the robot and rewards it."""
        pressed, true["new"] = true["new"], False
        return pressed

    world, clock, server = RingEnv(body=WIFI_BODY), VirtualClock(), TcpServer()
    world.reset(seed=1)
    with Emulator(world, server, WifiFirmware("request"), clock, on_step=see) as emulator:
        driver = Driver(Tcp(server.host, server.port, wait=0.0005), Wifi(), clock)
        calibration = Calibration(fov=WIFI_BODY.fov)
        robot = epuck.EPuck(HardwareEnv(driver, clock, calibration=calibration, key=press))
        agent, count = runner.load(exported, "onnx"), {"steps": 0}
        while true["completed"] < 2 and count["steps"] < 3000:
            count = merged(count, runner.run(agent, robot, 100, clock=Paced(clock)))
        assert true["completed"] == 2, true["found"]
        assert "GBYRGBYRG" in "".join(true["found"])
        assert count["bad observations"] == count["missed deadlines"] == 0
        assert np.abs(agent.state()[WEIGHTS].T - LEARNED).max() > 1e-2  # it kept learning
        robot.env.__exit__(None, None, None)
        clock.sleep_until(clock.now() + 0.1)
        assert emulator.speeds == (0, 0)
    world.close()


class Paced:
    """The clock of the robot, as the runner wants it."""

    def __init__(self, clock: VirtualClock) -> None:
        self.monotonic = clock.now
        self.sleep = lambda seconds: clock.sleep_until(clock.now() + seconds)


def merged(one: dict, other: dict) -> dict:
    return {name: one.get(name, 0) + number for name, number in other.items()}


class Still:
    """A robot that remembers what it was told to do; ``frames`` are its camera's."""

    def __init__(self, frames) -> None:
        self.frames, self.told = iter(frames), []

    def observe(self):
        return {"image": next(self.frames)}

    def drive(self, left: float, right: float) -> None:
        self.told.append((left, right))


def moving(agent) -> None:
    """Bring an agent to a state in which it turns."""
    for _ in range(100):
        wheels = agent.act({"image": IMAGE})
    assert wheels[1] > 0.1


@pytest.mark.parametrize("runtime", ["onnx", "torchscript"])
@pytest.mark.parametrize(
    "frame", [None, IMAGE[:-1], IMAGE.astype(np.float32), IMAGE.tobytes()], ids=str
)
def test_bad_frames_never_move_the_robot(exported, runtime, frame) -> None:
    agent = runner.load(exported, runtime)
    moving(agent)
    before = {name: value.copy() for name, value in agent.state().items()}
    robot = Still([frame] * 10)
    count = runner.run(agent, robot, 10, clock=Timeless())
    assert count["bad observations"] == 10 and set(robot.told) == {(0.0, 0.0)}
    for name, value in agent.state().items():
        np.testing.assert_array_equal(value, before[name])
    robot = Still([IMAGE, frame, IMAGE])
    runner.run(agent, robot, 3, clock=Timeless())
    assert [wheels != (0.0, 0.0) for wheels in robot.told] == [True, False, True, False]


def test_the_runner_gives_up_on_a_camera_that_stays_broken(exported) -> None:
    robot = Still([None] * 100)
    with pytest.raises(runner.BadInput, match="for 1 s nothing but bad input"):
        runner.run(runner.load(exported, "onnx"), robot, 100, clock=Timeless())
    assert set(robot.told) == {(0.0, 0.0)}


@pytest.mark.parametrize("runtime", ["onnx", "torchscript"])
def test_the_runner_ignores_numbers_that_are_not_finite(exported, runtime) -> None:
    agent, other = runner.load(exported, runtime), runner.load(exported, runtime)
    for step in range(100):
        bad = {50: {"reward": float("nan")}, 60: {"noise": np.full(4, np.inf)}}.get(step, {})
        wheels = agent.act({"image": IMAGE}, **bad)
        assert wheels == other.act({"image": IMAGE})
    assert wheels[1] > 0.1  # it goes on
    for name, value in other.state().items():
        np.testing.assert_array_equal(agent.state()[name], value + 2 * (name == "ignored"))
    agent.reset()
    assert agent.state()["ignored"] == 2  # counted over its life


@pytest.mark.parametrize("runtime", ["onnx", "torchscript"])
@pytest.mark.parametrize("observation", [{}, None, IMAGE], ids=["empty", "none", "no dict"])
def test_the_runner_refuses_an_observation_without_its_image(
    exported, runtime, observation
) -> None:
    with pytest.raises(runner.BadInput, match=r"lacks image: give a dict with \['image'\]"):
        runner.load(exported, runtime).act(observation)


def test_a_robot_stands_still_after_an_error(exported) -> None:
    robot = Still([IMAGE] * 3)
    with pytest.raises(StopIteration):
        runner.run(runner.load(exported, "onnx"), robot, 10, clock=Timeless())
    assert robot.told[-1] == (0.0, 0.0)


def test_exploration_is_that_of_the_library() -> None:
    library = Exploration(4, seed=7, amplitude=10.0)
    for decision in (0, 1, 5, 70_000):
        expected = library(torch.tensor(decision)).numpy()
        np.testing.assert_array_equal(runner.exploration(7, decision, 4, 10.0), expected)


@pytest.mark.parametrize("runtime", ["onnx", "torchscript"])
def test_learning_can_be_switched(exported, golden, runtime) -> None:
    agent = runner.load(exported, runtime)
    agent.learn(False)
    fixed = agent.state()[WEIGHTS].copy()
    rewarded = int(np.argmax(golden["run/reward"] > 0)) + 30
    for on in (False, True):
        agent.reset()
        agent.learn(on)
        for k in range(rewarded):
            agent.act({"image": golden["run/image"][k]}, float(golden["run/reward"][k]))
        assert np.array_equal(agent.state()[WEIGHTS], fixed) is not on


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda d: os.truncate(d / "agent.onnx", 1000), "agent.onnx is damaged or not of"),
        (lambda d: (d / "manifest.json").write_text("{"), "manifest.json cannot be used"),
        (lambda d: edit(d, lambda m: m["inputs"].pop()), "no agent of a robot"),
        (lambda d: edit(d, lambda m: m["state"].pop()), "its manifest says"),
        (lambda d: edit(d, lambda m: m.pop("dt")), "lacks"),
    ],
)
def test_the_runner_refuses_what_does_not_fit(damage, says, exported, tmp_path) -> None:
    damage(part_of(exported, tmp_path, "agent.onnx"))
    with pytest.raises(runner.Unfit, match=says):
        runner.load(tmp_path, "onnx")


ROBOT = """
import sys
import numpy
class Robot:
    def observe(self):
        assert "dntorch" not in sys.modules and "torch" not in sys.modules
        return {"image": numpy.zeros((39, 52, 3), numpy.uint8), "battery": 3.7}
    def drive(self, left, right):
        print("wheels", left, right)
"""


def test_the_runner_needs_neither_dntorch_nor_torch(exported, tmp_path) -> None:
    (tmp_path / "robot.py").write_text(ROBOT)
    command = [sys.executable, str(RUNNER), str(exported), "--robot", f"{tmp_path}/robot.py:Robot"]
    done = subprocess.run(
        [*command, "--seconds", "1"], capture_output=True, text=True, timeout=60, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("wheels") == 33 and "'steps': 32" in done.stdout
    done = subprocess.run([*command[:-1], "nowhere"], capture_output=True, text=True, timeout=60)
    assert (
        done.returncode == 1 and done.stderr == "run_agent: --robot=nowhere: give FILE.py:CLASS\n"
    )


def test_onnx_runtime_reads_the_state_that_the_manifest_names(exported, manifest) -> None:
    session = onnxruntime.InferenceSession(exported / "agent.onnx")
    names = [p["name"] for key in ("inputs", "switches", "state") for p in manifest[key]]
    assert [port.name for port in session.get_inputs()] == names
    state = [f"next.{port['name']}" for port in manifest["state"]]
    assert [port.name for port in session.get_outputs()] == ["action", *state]

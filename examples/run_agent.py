"""Drive a robot with an exported agent. One file: needs NumPy, and PyTorch or ONNX Runtime.

    python run_agent.py DIR --robot my_robot.py:MyRobot --runtime onnx --seconds 60

DIR is what ``dntorch export`` wrote. A robot is any class without arguments that has

    observe()           what it senses now, NumPy arrays by the names of the manifest: "image" is
                        a camera image, uint8 (height, width, 3), RGB, row 0 at the top
    drive(left, right)  wheel speeds in rad/s, obeyed until the next call
    reward()            optional: the reward at this moment, a number

The robot stands still after a bad observation, such as none at all or an image of another size,
after an error and at the end. A number that is NaN or infinite counts as 0: the agent ignores it
and counts the step.
"""

import argparse
import hashlib
import importlib.util
import json
import sys
import time
from pathlib import Path
from typing import Protocol

import numpy as np

PATIENCE = 1.0
"""Seconds of bad observations after which to give up."""
FORMAT = 3
"""Of the manifests that this program reads."""


class Robot(Protocol):
    def observe(self) -> dict[str, np.ndarray]: ...
    def drive(self, left: float, right: float) -> None: ...


class BadInput(ValueError):
    """An observation or noise that must not become motion."""


class Unfit(ValueError):
    """Files that don't fit each other, or a robot that isn't there."""


class Agent:
    """An exported agent: ``wheels = agent.act({"image": frame})``, one call per control step."""

    def __init__(self, folder: Path, suffix: str) -> None:
        self.manifest = m = read_manifest(folder)
        path = folder / f"{m['name']}{suffix}"
        entry = m["files"].get(path.name)
        if entry is None:
            raise Unfit(f"{folder} has no {path.name}: choose another --runtime")
        content = path.read_bytes() if path.exists() else b""
        if hashlib.sha256(content).hexdigest() != entry["sha256"]:
            raise Unfit(f"{path} is damaged or not of {folder}/manifest.json: export again")
        ports = {port["name"]: port for port in m["inputs"]}
        gives = {port["name"]: port["shape"] for port in m["outputs"]}
        if list(ports)[-2:] != ["reward", "noise"] or gives != {"action": [2]}:
            raise Unfit(f"{folder}/manifest.json is of {[*ports]} to {gives}: no agent of a robot")
        self.dt, self.max_speed = float(m["dt"]), float(m["max_speed"])
        self.n = ports.pop("noise")["shape"][0]
        del ports["reward"]
        self.senses = {name: (np.dtype(p["dtype"]), tuple(p["shape"])) for name, p in ports.items()}
        self.none = np.zeros(self.n, np.float32)
        self.load(path)

    def act(
        self,
        observation: dict[str, np.ndarray],
        reward: float = 0.0,
        noise: np.ndarray | None = None,
    ) -> tuple[float, float]:
        """Wheel speeds (left, right) in rad/s.

        Raises:
            BadInput: an observation without an array that the agent senses, or with one of
                another shape or type. The agent stays as it was.
        """
        seen = {name: self.sense(observation, name) for name in self.senses}
        noise = self.none if noise is None else np.asarray(noise, np.float32)
        if noise.shape != self.none.shape:
            raise BadInput(f"noise has shape {noise.shape}: give {self.none.shape}")
        wheels = self.step(seen | {"reward": np.array(reward, np.float32), "noise": noise})
        if wheels.shape != (2,) or not np.isfinite(wheels).all():
            raise BadInput(f"the agent answered {wheels}: reset it")
        left, right = np.clip(wheels.astype(float), -self.max_speed, self.max_speed)
        return float(left), float(right)

    def sense(self, observation: dict[str, np.ndarray], name: str) -> np.ndarray:
        dtype, shape = self.senses[name]
        if not isinstance(observation, dict) or name not in observation:
            raise BadInput(f"the observation lacks {name}: give a dict with {[*self.senses]}")
        array = observation[name]
        if not isinstance(array, np.ndarray) or (array.dtype, array.shape) != (dtype, shape):
            what = f"{getattr(array, 'dtype', type(array))} {getattr(array, 'shape', '')}"
            raise BadInput(f"{name} is {what}: give {dtype} of shape {shape}")
        return np.ascontiguousarray(array)


class ScriptAgent(Agent):
    """TorchScript: PyTorch holds the state."""

    def load(self, path: Path) -> None:
        import torch

        torch.set_num_threads(1)
        torch.set_flush_denormal(True)
        self.torch = torch
        self.module = torch.jit.load(path)
        expected = {port["name"]: port["shape"] for port in self.manifest["state"]}
        if {k: list(v.shape) for k, v in self.module.get_state().items()} != expected:
            raise Unfit(f"{path} has another state than its manifest says: export again")

    def step(self, inputs: dict[str, np.ndarray]) -> np.ndarray:
        with self.torch.inference_mode():
            return self.module(*map(self.torch.from_numpy, inputs.values())).numpy()

    def reset(self) -> None:
        """Back to rest; what was learned and counted stays."""
        self.module.reset()

    def learn(self, on: bool) -> None:
        self.module.learn(on)

    def state(self) -> dict[str, np.ndarray]:
        return {name: value.numpy() for name, value in self.module.get_state().items()}


class OnnxAgent(Agent):
    """ONNX Runtime: a pure function, the state is held here."""

    def load(self, path: Path) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.add_session_config_entry("session.set_denormal_as_zero", "1")
        self.session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        m = self.manifest
        names = [port["name"] for part in ("inputs", "switches", "state") for port in m[part]]
        takes = [port.name for port in self.session.get_inputs()]
        if takes != names:
            raise Unfit(f"{path} takes {takes}, its manifest says {names}: export again")
        self.fixed = {port["name"]: rest(port) for port in m["switches"]}
        self.held = {port["name"]: rest(port) for port in m["state"]}

    def step(self, inputs: dict[str, np.ndarray]) -> np.ndarray:
        wheels, *state = self.session.run(None, inputs | self.fixed | self.held)
        self.held = dict(zip(self.held, state))
        return wheels

    def reset(self) -> None:
        """Back to rest; what was learned and counted stays."""
        for port in self.manifest["state"]:
            if not port["lasting"]:
                self.held[port["name"]] = rest(port)

    def learn(self, on: bool) -> None:
        self.fixed = {name: np.full_like(value, on) for name, value in self.fixed.items()}

    def state(self) -> dict[str, np.ndarray]:
        return self.held


RUNTIMES = {"torchscript": (ScriptAgent, ".ts"), "onnx": (OnnxAgent, ".onnx")}


def load(folder: Path, runtime: str) -> Agent:
    kind, suffix = RUNTIMES[runtime]
    return kind(Path(folder), suffix)


def read_manifest(folder: Path) -> dict:
    needed = ("name", "dt", "max_speed", "inputs", "outputs", "switches", "state", "files")
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
        missing = [key for key in needed if key not in manifest]
    except (OSError, ValueError, TypeError) as error:
        raise Unfit(f"{folder}/manifest.json cannot be used ({error}): export again") from None
    if (given := manifest.get("format")) != FORMAT:
        raise Unfit(f"{folder}/manifest.json is of format {given}, not {FORMAT}: export again")
    if missing:
        raise Unfit(f"{folder}/manifest.json is no agent's, it lacks {missing}")
    return manifest


def rest(port: dict) -> np.ndarray:
    return np.broadcast_to(np.array(port["rest"], port["dtype"]), port["shape"]).copy()


def exploration(seed: int, decision: int, n: int, amplitude: float, agent: int = 0) -> np.ndarray:
    """Noise on the values that makes decision number ``decision`` a random one, ``(n,)``.

    The numbers that the agent was trained with: Philox4x32-10, keyed by what they are for.
    """
    mask, words = 0xFFFFFFFF, []
    for block in range(-(-n // 4)):
        c, k0, k1 = [block, decision & mask, agent, 0], seed, 1
        for _ in range(10):
            a, b = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
            c = [(b >> 32) ^ c[1] ^ k0, b & mask, (a >> 32) ^ c[3] ^ k1, a & mask]
            k0, k1 = (k0 + 0x9E3779B9) & mask, (k1 + 0xBB67AE85) & mask
        words += c
    uniform = np.array(words[:n], np.float64) / 2**32
    return (amplitude * uniform).astype(np.float32)


def run(agent: Agent, robot: Robot, steps: int, explore: bool = False, clock=time) -> dict:
    """The control loop, at the agent's rate. ``clock`` has ``monotonic`` and ``sleep``."""
    reward = getattr(robot, "reward", lambda: 0.0)
    count = {"steps": 0, "bad observations": 0, "missed deadlines": 0}
    noise, decided, bad = None, None, 0
    due = clock.monotonic()
    try:
        while count["steps"] < steps:
            if explore and (decision := int(agent.state()["decisions"])) != decided:
                settings, decided = agent.manifest["exploration"], decision
                noise = exploration(settings["seed"], decision, agent.n, settings["amplitude"])
            try:
                robot.drive(*agent.act(robot.observe(), float(reward()), noise))
                bad = 0
            except BadInput as error:
                robot.drive(0.0, 0.0)
                bad += 1
                count["bad observations"] += 1
                if bad * agent.dt > PATIENCE:
                    raise BadInput(f"for {PATIENCE:g} s nothing but bad input: {error}") from error
            count["steps"] += 1
            due += agent.dt
            if (late := clock.monotonic() - due) > 0:
                count["missed deadlines"] += 1
                due += late
            else:
                clock.sleep(-late)
    finally:
        robot.drive(0.0, 0.0)
    return count


def find_robot(where: str) -> Robot:
    file, _, name = where.rpartition(":")
    spec = importlib.util.spec_from_file_location("robot", file) if file else None
    if spec is None or not Path(file).exists():
        raise Unfit(f"--robot={where}: give FILE.py:CLASS")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", required=True, metavar="FILE.py:CLASS")
    parser.add_argument("--runtime", choices=RUNTIMES, default="onnx")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--learn", action="store_true", help="go on learning from rewards")
    parser.add_argument("--explore", action="store_true", help="choose behaviours at random")
    options = parser.parse_args()
    try:
        agent = load(options.folder, options.runtime)
        agent.learn(options.learn)
        steps = round(options.seconds / agent.dt)
        count = run(agent, find_robot(options.robot), steps, options.explore)
        print(count | {"ignored": int(agent.state()["ignored"])})
    except (BadInput, Unfit, ImportError) as error:
        sys.exit(f"run_agent: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()

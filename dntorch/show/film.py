"""A film of a trained agent at work, laid out as the paper's video of the robot."""

import contextlib
import copy
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import torch

from dntorch.envs.adaptor import GymWorld
from dntorch.envs.task import NOTHING
from dntorch.lock import PART
from dntorch.modules.sarsa import DNSarsa
from dntorch.quantities import check_quantities, per_second
from dntorch.runs.build import build_lifelong
from dntorch.runs.config import Config
from dntorch.runs.worlds import WORLDS
from dntorch.show.panels import SIZE, Moment, draw

STEPS_EACH = 250
"""Control steps after which the film ends, for each behaviour that was to be shown."""


def write_video(
    agent: DNSarsa,
    config: Config,
    path: Path,
    behaviors: int = 8,
    fps: float = 8,
    max_steps: int | None = None,
) -> Path:
    """Film a copy of ``agent``, from rest, in a fresh world, in real time.

    It acts without noise, unless the run has no phases.

    ``fps`` is how many pictures per second there are about: one falls on each so many control
    steps, and the film is as long as what happens in it.

    The agent itself is not touched; its copy learns on if the agent was learning. The film
    ends with the last of ``behaviors`` found colours, or after ``max_steps`` control steps.

    Raises:
        ValueError: ``fps`` that is not positive and finite.
        RuntimeError: this OpenCV cannot write, or read again, WebM films (VP8).
    """
    actor, stride = copy.deepcopy(agent), stride_of(fps, config)
    steps = max_steps or STEPS_EACH * behaviors
    return film(actor, config, _play(actor, config, behaviors, stride, steps), path, fps)


def stride_of(fps: float, config: Config) -> int:
    """Control steps from one picture of a film in real time to the next."""
    check_quantities(fps=fps)
    return max(1, round(1 / (fps * config.dt)))


def film(agent: DNSarsa, config: Config, moments: Iterator[Moment], path: Path, fps: float) -> Path:
    """Write a film of what an agent does: it is drawn as it is when each moment comes.

    Raises:
        RuntimeError: as `write_video`.
    """
    path = Path(path)
    partial = path.with_name(f".{path.stem}{PART}.webm")
    pace = per_second(stride_of(fps, config) * config.dt)
    writer = cv2.VideoWriter(str(partial), cv2.VideoWriter.fourcc(*"VP80"), pace, SIZE)
    try:
        if not writer.isOpened():
            raise RuntimeError(
                f"OpenCV {cv2.__version__} cannot write {path} as WebM with VP8: is the folder "
                "there? If so, install opencv-python-headless from PyPI"
            )
        # Frames are encoded while the world moves on.
        with ThreadPoolExecutor(1) as pool, contextlib.closing(moments):
            written = pool.submit(int)
            for moment in moments:
                frame = cv2.cvtColor(draw(agent, config, moment), cv2.COLOR_RGB2BGR)
                written.result()
                written = pool.submit(writer.write, frame)
        writer.release()
        _check(partial, path)
        os.replace(partial, path)
    finally:
        writer.release()
        partial.unlink(missing_ok=True)
    return path


def _check(partial: Path, path: Path) -> None:
    reader = cv2.VideoCapture(str(partial))
    readable = reader.isOpened() and reader.read()[0]
    reader.release()
    if not readable:
        raise RuntimeError(f"OpenCV {cv2.__version__} wrote {path}, but cannot read it again")


def _play(
    actor: DNSarsa, config: Config, behaviors: int, stride: int, max_steps: int
) -> Iterator[Moment]:
    """Let the agent act; stop and look every ``stride`` control steps."""
    actor.reset()
    env = WORLDS[config.world].env(
        config, senses=tuple({*actor.senses, "image"}), render_mode="rgb_array"
    )
    world = GymWorld(env)
    state = world.initial(seed=config.seed)
    observation, reward, noise = world.observe(state), torch.zeros(()), torch.zeros(actor.n)
    exploration = build_lifelong(config)
    found, rewards, end, outside = 0, 0, max_steps, env.render()
    try:
        for step in range(max_steps):
            if step == end:
                return
            with torch.inference_mode():
                if exploration is not None:
                    noise = exploration(actor.decisions)
                outcome, state = world.step(actor(observation, reward, noise), state)
            found += int(outcome.found != NOTHING)
            rewards += int(outcome.completed)
            observation, reward = outcome.observation, outcome.reward
            if step % stride == 0:
                # The outside view takes longer than all the rest: every second frame will do.
                outside = env.render() if step % (2 * stride) == 0 else outside
                image, rewarded = observation["image"].numpy(), bool(reward)
                yield Moment(outside, image, step, found, rewards, rewarded)
            if outcome.found != NOTHING and found == behaviors:
                end = step + round(1 / config.dt)  # a second more, to see what it leads to
    finally:
        world.close()

"""The worlds of a run, one row each. Adding one is a file in ``envs/`` and a row here."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import gymnasium
    from torch import Tensor

    from dntorch.body import Body
    from dntorch.envs.layout import Ring
    from dntorch.envs.task import SequenceTask
    from dntorch.envs.world import World
    from dntorch.runs.config import Config

Senses = tuple[str, ...]


class Row(NamedTuple):
    """What a run knows of a world. Builders import what they need: this table stays light."""

    text: str
    """one line for those who choose"""
    senses: Senses
    """what it can show"""
    build: Callable[[Config, Senses, SequenceTask, str], World]
    batched: bool
    """whether many agents step as one batch"""
    numbered: bool
    """whether runs beside each other have one seed and numbers, or seeds of their own"""
    env: Callable[..., gymnasium.Env] | None = None
    """the same as a Gymnasium env with a view from outside, to film and to emulate; None if
    there is nothing to see"""
    packages: tuple[str, ...] = ()
    """what it imports besides PyTorch and NumPy"""
    instead: str = ""
    """the world that `learn` takes where these are missing"""


def build_task(config: Config, others: tuple[str, ...] = ()) -> SequenceTask:
    """What a run rewards, ``others`` beside its sequence."""
    from dntorch.envs.task import SequenceTask

    rewarded = config.reward, config.reward_duration, config.dt
    then = (config.then, config.change) if config.then else None
    return SequenceTask(config.sequence, config.colors, *rewarded, others, then)


def _nodes(config: Config, senses: Senses, task: SequenceTask, device: str) -> World:
    from dntorch.envs.nodes import NodesWorld

    return NodesWorld(task, device=device, senses=senses, feasible=_feasible(config))


def _ring(config: Config, senses: Senses, task: SequenceTask, device: str) -> World:
    from dntorch.envs.ring import RingWorld

    return RingWorld(
        task, _ring_of(config), body=_body(config), dwell=config.dwell, senses=senses, device=device
    )


def _epuck(config: Config, senses: Senses, task: SequenceTask, device: str) -> World:
    from dntorch.envs.adaptor import GymWorld

    return GymWorld(_epuck_env(config, task=task, senses=senses, layout_seed=config.seed))


def _feasible(config: Config) -> Tensor | None:
    """Nothing finds what is missing."""
    if not config.missing:
        return None
    import torch

    there = torch.tensor([letter not in config.missing for letter in config.colors])
    return there.unsqueeze(-1).expand(-1, len(there)).clone()


def _ring_of(config: Config) -> Ring:
    from dntorch.envs.layout import Ring

    return Ring(4 * len(config.colors), missing=config.missing)


def _body(config: Config) -> Body:
    from dntorch.body import Body

    return Body(width=config.width, height=config.height)


def _epuck_env(config: Config, **others) -> gymnasium.Env:
    from dntorch.envs.epuck import EPuckEnv

    return EPuckEnv(**_of_an_env(config) | others)


def _ring_env(config: Config, **others) -> gymnasium.Env:
    from dntorch.envs.ring_env import RingEnv

    return RingEnv(**_of_an_env(config) | others)


def _of_an_env(config: Config) -> dict[str, Any]:
    from dntorch.runs.build import senses_of

    return {
        "task": build_task(config), "body": _body(config), "ring": _ring_of(config),
        "dwell": config.dwell, "senses": senses_of(config),
    }  # fmt: skip


ROBOT = ("image", "wheels", "proximity", "lamp")

WORLDS = {
    "epuck": Row(
        "PyBullet, from camera images", ROBOT, _epuck, batched=False, numbered=False,
        env=_epuck_env, packages=("pybullet", "gymnasium"), instead="ring",
    ),
    "ring": Row(
        "the same seen in torch, needs no PyBullet", ROBOT, _ring, batched=True, numbered=False,
        env=_ring_env,
    ),
    "nodes": Row(
        "abstract behaviours, without a camera", ("match", "lamp"), _nodes,
        batched=True, numbered=True,
    ),
}  # fmt: skip


def build_world(
    config: Config, senses: Senses, task: SequenceTask | None = None, device: str = "cpu"
) -> World:
    """The world of a run, which shows ``senses``; by default with the task of the config.

    Raises:
        ValueError: a sense that it does not have.
        ImportError: a package that it needs is not installed.
    """
    row = WORLDS[config.world]
    for name in senses:
        if name not in row.senses:
            raise ValueError(f"senses={senses}: {name!r} is unknown, give a tuple of {row.senses}")
    return row.build(config, senses, task or build_task(config), device)

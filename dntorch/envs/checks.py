"""What makes no world of blocks; each sentence names argument, value and remedy."""

from __future__ import annotations

import math
from typing import Any

from dntorch.body import Body
from dntorch.colors import check_missing
from dntorch.envs.layout import Light, Ring
from dntorch.envs.task import SequenceTask
from dntorch.quantities import Interval, check_kind, check_quantities, shown


def check_whole(
    task: SequenceTask | None, ring: Ring | None, light: Light, body: Body, tolerance: float
) -> tuple[SequenceTask, Ring]:
    """The task and the ring of a world; by default the paper's, and four blocks of each colour.

    Raises:
        ValueError: they are of another type, or do not fit each other or the judge's
            ``tolerance`` (rad).
    """
    check_kind("light", light, Light)
    check_kind("body", body, Body)
    task = SequenceTask() if task is None else task
    check_kind("task", task, SequenceTask)
    share = len(task.colors)
    ring = Ring(4 * share) if ring is None else ring
    check_kind("ring", ring, Ring)
    if ring.blocks % share:
        raise ValueError(f"blocks={ring.blocks!r}: give a multiple of the {share} colors")
    check_missing(ring.missing, task.colors)
    check_quantities(tolerance=tolerance)
    half = math.pi / ring.blocks
    if tolerance >= half:
        raise ValueError(f"tolerance={tolerance!r}: give less than half a pitch, {half:.3f} rad")
    return task, ring


def check_episode(layout_seed: int | None, render_mode: str | None, max_seconds: float | None):
    """Raise a ``ValueError`` for an argument of an env that makes no episode."""
    check_quantities(max_seconds=1.0 if max_seconds is None else max_seconds)
    if layout_seed is not None and layout_seed not in Interval(0, math.inf, whole=True):
        raise ValueError(f"layout_seed={layout_seed!r}: give None or an integer from 0")
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode={render_mode!r}: give 'rgb_array' or None")


def check_snapshot(state: Any, world: str, kind: str) -> None:
    """Raise a ``ValueError`` unless a snapshot is of this world of an env of that kind."""
    of = state.get("world") if isinstance(state, dict) else None
    if of is None:
        raise ValueError(f"state={shown(state)} is no snapshot: give what state_dict() returned")
    if of != world:
        raise ValueError(f"the snapshot is of another world: build {kind}({of}) to load it")

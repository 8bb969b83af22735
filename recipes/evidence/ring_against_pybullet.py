"""The ring in torch beside PyBullet: the same scenes, pixel by pixel.

For boxes and cylinders and two layouts each, robots at random poses (a third in the middle of
the ring, a third within 3 cm, a third within 20 cm) photograph the ring with both. Prints for
each: pixels that differ at all and by more than 2 levels of 255 in any channel, the largest
difference of the share of a hue in a column, how far the blocks that both see are apart in
columns, and the largest difference of bearings and of proximity readings. A minute.

    python recipes/evidence/ring_against_pybullet.py --poses 500
"""

import argparse
import colorsys
import math

import numpy as np
import torch

from dntorch.body import EPUCK
from dntorch.cells.color import hue_columns
from dntorch.colors import HUES, MIN_SATURATION, MIN_VALUE, PAPER
from dntorch.envs import Ring, sensors
from dntorch.envs.layout import DAYLIGHT
from dntorch.envs.pose import Pose
from dntorch.envs.ring import draw_layout
from dntorch.envs.ring_camera import RingCamera
from dntorch.envs.scene import Scene

PAINTS = np.array([colorsys.hsv_to_rgb(HUES[letter] / 360, 1, 1) for letter in PAPER])


def draw_poses(count: int, seed: int) -> np.ndarray:
    """x, y (m) and yaw (rad) of ``count`` robots."""
    random = np.random.default_rng(seed)
    far = np.array([0.0, 0.03, 0.20])[np.arange(count) % 3]
    place = random.uniform(-1, 1, (count, 2)) * far[:, None]
    return np.column_stack((place, random.uniform(-math.pi, math.pi, count)))


def standing(x: float, y: float, yaw: float) -> Pose:
    c, s = math.cos(yaw), math.sin(yaw)
    return Pose(np.array([x, y, 0.0]), np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]))


def shares(images: np.ndarray) -> torch.Tensor:
    """Share of each column of each image that has the hue of each of 12 bins."""
    return hue_columns(torch.from_numpy(images), 12, MIN_SATURATION, MIN_VALUE)


def middles(share: torch.Tensor) -> list[float]:
    """Middle column of every stretch of columns that has one hue, for whole stretches."""
    found = []
    for row in (share > 0).int().numpy():
        edges = np.flatnonzero(np.diff(row))
        inner = edges[1:] if row[0] else edges
        found += [(a + 1 + b) / 2 for a, b in zip(inner[::2], inner[1::2])]
    return found


def compare(shape: str, seed: int, poses: np.ndarray) -> dict[str, float]:
    ring = Ring(block_shape=shape)
    layout = draw_layout(ring, PAPER, seed)
    scene, camera = Scene(ring, DAYLIGHT), RingCamera(ring, DAYLIGHT, EPUCK, PAPER)
    scene.paint(PAINTS[layout])
    places = [standing(*pose) for pose in poses]
    there = np.stack([sensors.image(scene, EPUCK, place) for place in places])
    bearings = np.stack([sensors.bearings(ring.centers, EPUCK, place) for place in places])
    near = np.stack([sensors.proximity(scene, place) for place in places])
    scene.close()
    pose = torch.from_numpy(poses).float().unbind(-1)
    layouts = torch.tensor(layout).expand(len(poses), -1)
    here = camera.image(camera.walls(*pose), layouts).contiguous().numpy()
    levels = abs(here.astype(int) - there).max(-1)
    wrong = (levels > 2).mean((1, 2))
    mine, theirs = shares(here), shares(there)
    pairs = [(middles(a), middles(b)) for a, b in zip(mine, theirs, strict=True)]
    off = [abs(np.subtract(a, b)).max(initial=0) for a, b in pairs if len(a) == len(b)]
    return {
        "pixels that differ, %": 100 * (levels > 0).mean(),
        "pixels off by more than 2, %": 100 * wrong.mean(),
        "in the worst image, %": 100 * wrong.max(),
        "hue share, largest difference": float((mine - theirs).abs().max()),
        "blocks, largest shift in columns": max(off),
        "images with other blocks": len(pairs) - len(off),
        "bearing, rad": abs(camera.bearings(*pose).numpy() - bearings).max(),
        "proximity, % of the reading": 100 * abs(camera.proximity(*pose).numpy() / near - 1).max(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=500)
    count = parser.parse_args().poses
    for shape in ("box", "cylinder"):
        for seed in (0, 1):
            print(f"{shape}, layout {seed}, {count} poses")
            for name, value in compare(shape, seed, draw_poses(count, seed)).items():
                print(f"    {name}: {value:.4g}")


if __name__ == "__main__":
    main()

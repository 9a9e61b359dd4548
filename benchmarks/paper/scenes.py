"""Worlds of the paper that no public set has: its large scene from several start places, and two places for robots."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from actors.maps.clear_space import clear_space
from actors.maps.connectivity import reachable
from actors.maps.grid_map import GridMap
from actors.maps.sources import open_sources
from benchmarks.paper.plan import LARGE_STARTS
from common.errors import MapError

_PIXEL: Final = 0.1
"""Metres, of the places for robots."""
_FREE: Final = 254
_RADIUS: Final = 0.25
"""Of the robot, metres."""

_SETTINGS: Final = """[maps]
metres_per_pixel = {scale}

[mapping]
resolution = {resolution}
sensor_range = 20.0
viewpoint_spacing = 4.0
robot_radius = 0.25

[task]
unseen_area = 15.6
"""


def make_scenes(maps: Path, out: Path) -> None:
    """Make the folders `large`, `laboratory` and `garden`, each with its worlds and their settings.

    Args:
        maps: folder of the public maps; its ``cmu/indoor.png`` is the large scene.
        out: folder for the scenes.

    Raises:
        MapError: the large scene is not there.
    """
    for name, free in (("laboratory", laboratory()), ("garden", garden())):
        folder = _made(out / name)
        Image.fromarray(np.where(free[::-1], np.uint8(_FREE), np.uint8(0))).save(folder / f"{name}.png")
        (folder / "worlds.toml").write_text(
            _SETTINGS.format(scale=_PIXEL, resolution=0.2) + f'\n[worlds."{name}.png"]\nstart = [1.5, 1.5]\n', "utf-8"
        )
    _large(maps / "cmu" / "indoor.png", out / "large")


def laboratory() -> NDArray[np.bool_]:
    """Return the free cells of a laboratory of 30 m x 10 m: benches in two rows, a store and an office behind doors."""
    free = _hall(30.0, 10.0)
    for left in np.arange(3.0, 19.0, 4.0):
        _fill(free, left, 2.2, left + 2.2, 3.2)
        _fill(free, left + 0.8, 6.2, left + 3.0, 7.2)
    _fill(free, 21.0, 0.0, 21.2, 10.0)  # wall with two doors of 1 m
    _fill(free, 21.0, 5.0, 30.0, 5.2)
    _carve(free, 21.0, 2.0, 21.2, 3.0)
    _carve(free, 21.0, 7.0, 21.2, 8.0)
    _fill(free, 24.0, 1.0, 25.0, 3.6)
    _fill(free, 26.5, 6.6, 28.6, 7.6)
    _fill(free, 13.0, 4.4, 13.6, 5.0)  # column
    return free


def garden() -> NDArray[np.bool_]:
    """Return the free cells of a garden of 40 m x 20 m: hedges with gaps, trees, beds and a shed."""
    free = _hall(40.0, 20.0)
    _fill(free, 12.0, 0.0, 12.8, 14.0)
    _carve(free, 12.0, 5.0, 12.8, 6.6)
    _fill(free, 26.0, 6.0, 26.8, 20.0)
    _carve(free, 26.0, 14.0, 26.8, 15.6)
    _fill(free, 30.0, 2.0, 36.0, 6.0)  # shed, open to the garden on one side
    _carve(free, 30.4, 2.4, 35.6, 5.6)
    _carve(free, 32.0, 5.6, 33.4, 6.0)
    _fill(free, 16.0, 9.0, 22.0, 11.0)  # bed
    rows, columns = np.indices(free.shape)
    for x, y, radius in (
        (5.0, 6.0, 0.4), (8.0, 13.0, 0.5), (4.5, 16.5, 0.3), (17.0, 4.0, 0.5), (21.5, 15.5, 0.6),
        (23.0, 6.0, 0.4), (16.0, 17.0, 0.4), (31.0, 12.0, 0.5), (35.5, 16.0, 0.6), (37.0, 9.5, 0.4),
    ):  # fmt: skip
        free &= np.hypot((columns + 0.5) * _PIXEL - x, (rows + 0.5) * _PIXEL - y) > radius
    return free


def start_places(world: GridMap, count: int) -> list[tuple[float, float]]:
    """Return a world's start and further places, metres, each as far as possible from those before it.

    They have room for the robot: twice its radius to the next wall.
    """
    clear, begin = clear_space(world, 2.0 * _RADIUS)
    inside = reachable(clear, begin)
    rows, columns = np.nonzero(inside)
    cells = (np.column_stack([columns, rows]) + 0.5) * world.resolution + np.array(world.origin)
    places = [world.start]
    nearest = np.hypot(*(cells - np.array(world.start)).T)
    while len(places) < count:
        x, y = cells[int(np.argmax(nearest))].tolist()
        places.append((x, y))
        nearest = np.minimum(nearest, np.hypot(cells[:, 0] - x, cells[:, 1] - y))
    return places


def _large(plan: Path, out: Path) -> None:
    if not plan.is_file():
        raise MapError(f"{plan} is missing: 'hd-eval maps cmu' tells how to make it")
    world = open_sources([f"cmu:{plan}"], None, "exploration").world(0)
    folder = _made(out)
    lines = [_SETTINGS.format(scale=world.resolution, resolution=world.resolution)]
    for number, (x, y) in enumerate(start_places(world, LARGE_STARTS)):
        name = f"start-{number}.png"
        shutil.copyfile(plan, folder / name)
        lines.append(f'\n[worlds."{name}"]\nstart = [{x}, {y}]\n')
    (folder / "worlds.toml").write_text("".join(lines), "utf-8")


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _hall(width: float, height: float) -> NDArray[np.bool_]:
    """Return the free cells of an empty hall with walls of 0.2 m; metres."""
    free = np.zeros((round(height / _PIXEL), round(width / _PIXEL)), dtype=np.bool_)
    _carve(free, 0.2, 0.2, width - 0.2, height - 0.2)
    return free


def _carve(free: NDArray[np.bool_], left: float, bottom: float, right: float, top: float) -> None:
    free[round(bottom / _PIXEL) : round(top / _PIXEL), round(left / _PIXEL) : round(right / _PIXEL)] = True


def _fill(free: NDArray[np.bool_], left: float, bottom: float, right: float, top: float) -> None:
    free[round(bottom / _PIXEL) : round(top / _PIXEL), round(left / _PIXEL) : round(right / _PIXEL)] = False

"""How many decisions a world takes: a rule based on its area and on how much of it is seen at once.

From a place x of a world an area V(x) is in sight. As sight is mutual, a planner that saw nothing twice would need
about N = integral of dA / V looks for the whole area A; that is A / V where V is the same everywhere. Measured on
public maps, generators and the CMU plan, with 20 m of range: per look the best of nearest, greedy and TARE takes
decisions for 13 to 29 m of viewpoint spacings, and the worst of them for at most 54 m (docs/evaluation.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from actors.maps.connectivity import reachable
from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.mapping.raycast import cast_rays

NEEDED_WAY: Final = 32.0
"""Metres of viewpoint spacings for each look: fewer than these, and good planners are likely to fail."""
AMPLE_WAY: Final = 64.0
"""Metres of viewpoint spacings for each look: more than any planner took that found an end."""
FEWEST: Final = 128
"""Decisions of the public benchmark."""
MOST: Final = 10_000
"""The largest value of `task.max_steps`."""
_PLACES = 256
_RAYS = 180
# Square metres: who stands in a niche sees little of it, and niches are seen from outside.
_SMALLEST_VIEW = 10.0
_ROUND = 50


def looks(world: GridMap, sensor_range: float) -> float:
    """Estimate how many looks show a world: the integral of dA / V over what can be reached from its start.

    Args:
        world: the true map.
        sensor_range: metres.
    """
    cells = np.flatnonzero(reachable(world.free, world.cell(world.start)))
    chosen = cells[np.arange(_PLACES) * len(cells) // _PLACES]
    angles = np.linspace(-np.pi, np.pi, _RAYS, endpoint=False)
    shares = []
    for row, column in zip(*np.unravel_index(chosen, world.free.shape), strict=True):
        x = world.origin[0] + (column + 0.5) * world.resolution
        y = world.origin[1] + (row + 0.5) * world.resolution
        ranges = cast_rays(world.free, world.resolution, *world.origin, x, y, angles, sensor_range)
        view = float(np.sum(np.minimum(ranges, sensor_range) ** 2)) * np.pi / _RAYS
        shares.append(1.0 / max(view, _SMALLEST_VIEW))
    return len(cells) * world.resolution**2 * float(np.mean(shares))


def ample_way(world: GridMap, sensor_range: float) -> float:
    """Return metres that suffice to explore a world, whoever decides.

    Args:
        world: the true map.
        sensor_range: metres.
    """
    return looks(world, sensor_range) * AMPLE_WAY


def needed_steps(world: GridMap, mapping: MappingConfig) -> int:
    """Return with how many decisions good planners are likely to explore a world."""
    return math.ceil(looks(world, mapping.sensor_range) * NEEDED_WAY / mapping.viewpoint_spacing)


def step_limit(worlds: Iterable[GridMap], mapping: MappingConfig) -> int:
    """Return a step limit that is ample for the largest of some worlds, from `FEWEST` to `MOST`."""
    most = max(ample_way(world, mapping.sensor_range) for world in worlds)
    steps = most / mapping.viewpoint_spacing
    return FEWEST if steps <= FEWEST else min(math.ceil(steps / _ROUND) * _ROUND, MOST)


def warn_of_limit(worlds: Iterable[GridMap], limit: int, mapping: MappingConfig) -> str:
    """Return a sentence about worlds that take more decisions than the limit; empty where none does."""
    needs = [(needed_steps(world, mapping), world) for world in worlds]
    short = [(steps, world) for steps, world in needs if steps > limit]
    if not short:
        return ""
    steps, world = max(short, key=lambda each: each[0])
    area = np.count_nonzero(reachable(world.free, world.cell(world.start))) * world.resolution**2
    return (
        f"{limit} decisions are likely to be too few for {len(short)} of {len(needs)} worlds looked at: {world.name}, "
        f"{area:,.0f} m2, takes about {steps}; raise the limit with --set task.max_steps={2 * steps}"
    )

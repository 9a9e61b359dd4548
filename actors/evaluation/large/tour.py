"""The targets of a tour through a world."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from actors.maps.connectivity import reachable
from actors.maps.grid_map import GridMap
from actors.maps.layout import BLOCK, marker_region
from actors.simulators.clearance import clearance
from common.errors import MapError
from common.geometry import Pose
from common.planners.base import Position

# A leg is at least this share of the world's diagonal long, as the crow flies: the way is through several rooms.
LEG_SHARE: Final = 0.3
# Room around a target, metres: the robot, and a margin for planners that keep one.
ROOM: Final = 0.6
# The targets are drawn by a stream of their own, so that planners' and simulator's chance do not touch them.
_STREAM: Final = 0x70_1255


def tour_targets(world: GridMap, count: int, seed: int) -> list[Position]:
    """Draw the targets of a tour that begins at the world's start.

    Args:
        world: where; targets are centres of its blocks that can be reached and have room for a robot.
        count: number of targets.
        seed: equal seeds give equal tours.

    Returns:
        (x, y) in metres, in order; each at least `LEG_SHARE` of the diagonal from the one before.

    Raises:
        MapError: the world is too small or too full for that.
    """
    rng = np.random.default_rng([_STREAM, seed])
    free = reachable(world.free, world.cell(world.start))
    half = BLOCK // 2
    rows, columns = world.free.shape
    bottom = (rows - half) % BLOCK
    places = [
        (world.origin[0] + column * world.resolution, world.origin[1] + row * world.resolution)
        for row in range(bottom, rows, BLOCK)
        for column in range(half, columns, BLOCK)
        if row > 0 and free[row - 1 : row + 1, column - 1 : column + 1].all()
    ]
    places = [place for place in places if clearance(world, place, ROOM) >= ROOM]
    shortest = LEG_SHARE * float(np.hypot(*world.size))
    targets: list[Position] = []
    here = Pose(*world.start)
    for _ in range(count):
        far = [place for place in places if place not in targets and here.distance_to(place) >= shortest]
        if not far:
            raise MapError(
                f"map {world.name!r} has no place for target {len(targets) + 1} of {count} that is {shortest:.0f} m "
                "from the one before: ask for fewer targets, or use a larger world"
            )
        targets.append(far[int(rng.integers(len(far)))])
        here = Pose(*targets[-1])
    return targets


def leg_world(world: GridMap, start: Position, target: Position) -> GridMap:
    """Return the world of one leg: the same walls, another start and target."""
    centre = (
        (target[0] - world.origin[0]) / world.resolution,
        (target[1] - world.origin[1]) / world.resolution,
    )
    region = marker_region((world.free.shape[0], world.free.shape[1]), centre) & world.free
    return replace(world, start=start, target=target, target_region=region)

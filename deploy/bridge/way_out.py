"""The way out of a place where the robot does not fit by its map: beside a wall, in a narrow corner, in an obstacle."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE
from common.planners.base import Position
from deploy.bridge.cell_way import centre_of, nearest_way

# Places that are tried, nearest first, where free cells lead to none.
_MAX_PLACES: Final = 16


def way_out(mapper: Mapper, pose: Pose, reach: float) -> list[Position]:
    """Find the nearest place where the robot fits, and leave the mapper updated there.

    It is looked for through free cells, so that no wall is between. Where they lead to none, map and robot disagree,
    and the nearest place in a straight line is the best guess.

    Args:
        mapper: stuck at the pose.
        pose: of the robot.
        reach: of that guess, metres.

    Returns:
        Corners of the way, the place last, metres; empty when there is no such place. The mapper is left updated at the
        pose then.
    """
    room = mapper.room
    way = nearest_way(mapper, pose.position, mapper.belief.padded == FREE, room)
    for places in [way] if way else _straight(mapper, pose, room, reach):
        mapper.update(Pose(*places[-1], pose.yaw))
        if not mapper.stuck:
            return places
    mapper.update(pose)
    return []


def _straight(mapper: Mapper, pose: Pose, room: NDArray[np.bool_], reach: float) -> list[list[Position]]:
    """Return the nearest places with room in reach; neighbours mostly see the same, so they are spread."""
    cells = np.flatnonzero(room)
    x, y = centre_of(mapper, 0)
    rows, columns = np.divmod(cells, room.shape[1])
    size = mapper.belief.resolution
    distance = np.hypot(x + columns * size - pose.x, y + rows * size - pose.y)
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] <= reach]
    step = max(len(order) // _MAX_PLACES, 1)
    return [[centre_of(mapper, int(cell))] for cell in cells[order[::step]]]

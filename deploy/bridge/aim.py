"""Where a robot that is driven by a stack of its own is sent: the corner of its way that is ahead and in sight."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, hypot, inf
from typing import Final

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position

# Local planners know their surroundings only: farther waypoints end in dead ends, metres.
FARTHEST: Final = 8.0


class Aim:
    """Walks along a way: a place stays the aim until the robot is there, or until it sees a later one.

    So the aim jumps from corner to corner, and a stack that begins anew with every goal is told only what is new.

    Usage::

        aim = Aim(pose, route, arrival_radius)
        waypoint = aim.advance(mapper, pose)  # at every pass
    """

    def __init__(self, pose: Pose, way: Sequence[Position], arrival_radius: float) -> None:
        """Begin a way.

        Args:
            pose: of the robot.
            way: corners, metres, at least one; legs longer than `FARTHEST` are parted.
            arrival_radius: a corner counts as reached within this distance, metres.
        """
        self._places: list[Position] = []
        last = pose.position
        for place in way:
            parts = max(1, ceil(hypot(place[0] - last[0], place[1] - last[1]) / FARTHEST))
            self._places += [
                (last[0] + k / parts * (place[0] - last[0]), last[1] + k / parts * (place[1] - last[1]))
                for k in range(1, parts)
            ]
            self._places.append(place)
            last = place
        self._arrival_radius = arrival_radius
        self._at = 0
        self._gap = inf

    def advance(self, mapper: Mapper, pose: Pose) -> Position:
        """Return the aim of this moment."""
        places = self._places
        gap = pose.distance_to(places[self._at])
        if self._at < len(places) - 1 and gap <= self._arrival_radius and gap >= self._gap:
            # As near as the robot gets: a stack that stops before its goal never sees around the corner.
            self._at, gap = self._at + 1, inf
        self._gap = gap
        for k in range(len(places) - 1, self._at, -1):
            if pose.distance_to(places[k]) <= FARTHEST and mapper.segment_free(pose.position, places[k]):
                self._at, self._gap = k, inf
                break
        return places[self._at]

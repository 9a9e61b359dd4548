"""The rules of the nominal protocol for the ways that a planner of free positions may ask for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from common.errors import HDError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Position
from common.planners.viewpoint_planner import TOLERANCE

# Nearer to its viewpoint than this, metres, the robot counts as standing on it.
ON_VIEWPOINT = 0.3


def check_way(mapper: Mapper, pose: Pose, way: Sequence[Position], spacing: float) -> None:
    """Check that every leg of a way is short enough and known to be free.

    The way home to its viewpoint that the mapper gives may come nearer to obstacles than the robot is. A robot that
    found an obstacle behind it to reach farther than it was known to when it passed has no other way out.

    Args:
        mapper: what the robot knows.
        pose: where it stands.
        way: corners and end, metres, map frame.
        spacing: distance between neighbouring viewpoints, metres; a leg may be `LONGEST_EDGE` of them long.

    Raises:
        HDError: the way breaks the rules.
    """
    for position in way:
        if not np.isfinite(position).all():
            raise HDError(f"a waypoint must be two finite coordinates in metres, got {position}")
    # A robot beside its viewpoint, as robots with wheels are, may also go by the edges of that viewpoint.
    places = [pose]
    if not mapper.stuck:
        node = Pose(*mapper.position(mapper.robot))
        places += [node] if 0.0 < pose.distance_to(node.position) <= ON_VIEWPOINT else []
    longest = LONGEST_EDGE * spacing
    home = way_out(mapper, pose, way)
    if not home:
        _check_leg(mapper, places, way[0], longest)
    for a, b in pairwise(way[max(len(home) - 1, 0) :]):
        _check_leg(mapper, [Pose(*a)], b, longest)


def way_out(mapper: Mapper, pose: Pose, way: Sequence[Position]) -> list[Position]:
    """Return the mapper's way home where a way begins with that and not in the open, empty otherwise."""
    if mapper.stuck or mapper.segment_free(pose.position, way[0]):
        return []
    home = mapper.way_home()
    return home if list(way[: len(home)]) == home else []


def _check_leg(mapper: Mapper, places: Sequence[Pose], position: Position, longest: float) -> None:
    """Check the leg to a position from one of several places, where the robot is or counts as being."""
    here = places[0].position
    near = [place for place in places if place.distance_to(position) <= longest + TOLERANCE]
    if not near:
        raise HDError(
            f"a waypoint may be {longest:.2f} m away (one edge), got {places[0].distance_to(position):.2f} m from "
            f"{_shown(here)} to {_shown(position)}: cut the path there"
        )
    if not any(mapper.segment_free(place.position, position) for place in near):
        raise HDError(
            f"the way from {_shown(here)} to {_shown(position)} is not known to be free: choose a waypoint that is "
            "in line of sight through known free space"
        )


def _shown(position: Position) -> str:
    return f"({position[0]:.2f}, {position[1]:.2f})"

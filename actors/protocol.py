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
    longest = LONGEST_EDGE * spacing
    home = [] if mapper.stuck else mapper.way_home()
    legs = [pose.position, *way]
    if list(way[: len(home)]) == home:
        legs = legs[len(home) :]
    for a, b in pairwise(legs):
        _check_leg(mapper, Pose(*a), b, longest)


def _check_leg(mapper: Mapper, pose: Pose, position: Position, longest: float) -> None:
    """Check the leg from a pose to a position."""
    here = pose.position
    if pose.distance_to(position) > longest + TOLERANCE:
        raise HDError(
            f"a waypoint may be {longest:.2f} m away (one edge), got {pose.distance_to(position):.2f} m from "
            f"{_shown(here)} to {_shown(position)}: cut the path there"
        )
    if not mapper.segment_free(here, position):
        raise HDError(
            f"the way from {_shown(here)} to {_shown(position)} is not known to be free: choose a waypoint that is "
            "in line of sight through known free space"
        )


def _shown(position: Position) -> str:
    return f"({position[0]:.2f}, {position[1]:.2f})"

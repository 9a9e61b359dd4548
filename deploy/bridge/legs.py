"""What the map says about the legs of a plan: free, allowed, worth driving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE
from common.planners.base import Plan, Position


def nothing_to_see(mapper: Mapper, goal: Position) -> bool:
    """Whether a viewpoint, metres, observes no frontier any more; False for places that are none."""
    if mapper.stuck:
        return False
    gaps = np.hypot(*(mapper.viewpoints - np.array(goal)).T)
    node = int(gaps.argmin())
    return bool(gaps[node] < mapper.belief.resolution and mapper.observe().utility[node] == 0)


def begun_at(mapper: Mapper, pose: Pose, place: Pose, plan: Plan) -> Plan:
    """Begin a plan with the place that it was made for, where the robot cannot cut the corner.

    A robot that has come to a stand near that place will come no nearer: callers send it on as the plan says.
    """
    waypoint = plan.waypoint
    if waypoint is None or place is pose or place.position == waypoint or mapper.segment_free(pose.position, waypoint):
        return plan
    return replace(plan, waypoint=place.position, path=[waypoint, *plan.path])


def drivable(
    mapper: Mapper, places: Sequence[Position], may_enter: Callable[[Position, Position], bool]
) -> tuple[Position, ...]:
    """Return the first of the places, and those after it as far as legs are known to be free and allowed."""
    kept = [places[0]]
    for place in places[1:]:
        if not mapper.segment_free(kept[-1], place) or not may_enter(kept[-1], place):
            break
        kept.append(place)
    return tuple(kept)


def free_in(mapper: Mapper) -> Callable[[Position], bool]:
    """Return the question whether a position, metres, is known to be free."""
    return lambda position: mapper.belief.at(position) == FREE

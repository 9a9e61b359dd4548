"""What the map says about the legs of a plan: free, allowed, worth driving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE
from common.planners.base import Plan, Position


def begun_at(mapper: Mapper, pose: Pose, way: Sequence[Position], plan: Plan) -> Plan:
    """Begin a plan with the way to the place that it was made for, where the robot cannot cut the corner.

    A robot that has come to a stand near that place will come no nearer: callers send it on as the plan says.

    Args:
        mapper: of this moment.
        pose: of the robot.
        way: from the robot to the place that the plan was made for, that included; empty when the robot is there.
        plan: with a waypoint.
    """
    if plan.waypoint is None or not way:
        return plan
    first = plan.via[0] if plan.via else plan.waypoint
    if way[-1] == first or mapper.segment_free(pose.position, first):
        return plan
    return replace(plan, via=[*way, *plan.via])


def drivable(mapper: Mapper, plan: Plan, may_enter: Callable[[Position, Position], bool]) -> tuple[Position, ...]:
    """Return the corners of the way to a plan's waypoint, then what lies beyond as far as it is free and allowed.

    Edges of the graph that are not straight are driven by their corners.
    """
    assert plan.waypoint is not None
    kept = [*plan.via, plan.waypoint]
    for place in plan.path:
        legs = _legs(mapper, kept[-1], place)
        if not legs or not all(may_enter(a, b) for a, b in zip([kept[-1], *legs], legs, strict=False)):
            break
        kept += legs
    return tuple(kept)


def _legs(mapper: Mapper, start: Position, end: Position) -> list[Position]:
    """Return how to drive from one place to another: straight, or along the edge between the two; empty for no way."""
    if mapper.segment_free(start, end):
        return [end]
    nodes = []
    for place in (start, end):
        gaps = np.hypot(*(mapper.viewpoints - np.array(place)).T)
        node = int(gaps.argmin())
        if gaps[node] > 1e-6:
            return []
        nodes.append(node)
    a, b = nodes
    return mapper.way(a, b) if b in mapper.adjacency.of(a) else []


def free_in(mapper: Mapper, *, with_room: bool) -> Callable[[Position], bool]:
    """Return the question whether a position, metres, is known to be free, and has room for the robot where asked."""
    if with_room:
        return mapper.has_room
    return lambda position: mapper.belief.at(position) == FREE

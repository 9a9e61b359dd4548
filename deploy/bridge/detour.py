"""A way around places that are banned, for when the planner's own choice is one of them."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE
from common.planners.base import Plan, Position, Status

Allowed = Callable[[Position], bool]

# Goals that are tried, nearest first; more would cost time that a decision does not have.
_MAX_GOALS: Final = 8
# Free cells that are tried as a place to start from.
_MAX_PLACES: Final = 16


def useful_nodes(mapper: Mapper, target: Position | None) -> NDArray[np.int64]:
    """Return the nodes worth going to: those that observe frontiers and were not visited, and a known target.

    What a visit did not resolve, another one will not either.
    """
    observation = mapper.observe()
    nodes = np.flatnonzero((observation.utility > 0) & ~observation.visited)
    return np.append(nodes, observation.viewpoints) if target is not None and mapper.target_known else nodes


def detour(mapper: Mapper, pose: Pose, target: Position | None, allowed: Allowed) -> Plan:
    """Go to the nearest useful viewpoint that can be reached over allowed viewpoints alone.

    With a target, nearness counts the straight rest to the target.

    Args:
        mapper: updated at the pose.
        pose: of the robot.
        target: of navigation, or None.
        allowed: whether the robot may go to a position.
    """
    if mapper.stuck:
        return Plan(Status.STUCK, reason="no viewpoint can be reached in a straight free line from the robot")
    goals = [int(node) for node in useful_nodes(mapper, target) if allowed(mapper.position(int(node)))]
    best: tuple[float, list[int]] | None = None
    for first in mapper.observe().waypoint_nodes().tolist():
        place = mapper.position(first)
        if not allowed(place):
            continue
        if first == len(mapper.viewpoints):
            return Plan(Status.GOING, waypoint=place, beacon=place, reason="a way around banned places")
        distances = mapper.distances(first)
        costs = {goal: float(distances[goal]) + _rest(mapper.position(goal), target) for goal in goals}
        for goal in sorted(costs, key=costs.__getitem__)[:_MAX_GOALS]:
            cost = pose.distance_to(place) + costs[goal]
            if not np.isfinite(cost) or (best is not None and cost >= best[0]):
                break
            route = mapper.path(first, goal)
            if all(allowed(mapper.position(node)) for node in route):
                best = cost, route
                break
    if best is None:
        return Plan(Status.UNREACHABLE, reason="every way to what is left is banned or fenced off")
    places = [mapper.position(node) for node in best[1]]
    return Plan(
        Status.GOING, waypoint=places[0], beacon=places[-1], path=places[1:], reason="a way around banned places"
    )


def nearest_free_place(mapper: Mapper, pose: Pose, reach: float) -> Pose | None:
    """Find a place near a robot whose own cell is not free, from which viewpoints can be reached.

    The mapper is left updated at the place that is returned, or at the last one that was tried.

    Args:
        mapper: whose map and robot disagree.
        pose: of the robot.
        reach: metres.
    """
    belief = mapper.belief
    resolution = belief.resolution
    row, column = belief.cell(pose.position)
    span = int(reach / resolution) + 1
    rows, columns = belief.shape
    low_row, low_column = max(row - span, 0), max(column - span, 0)
    box = belief.cells[low_row : min(row + span + 1, rows), low_column : min(column + span + 1, columns)]
    free_rows, free_columns = np.nonzero(box == FREE)
    x = belief.origin[0] + (free_columns + low_column + 0.5) * resolution
    y = belief.origin[1] + (free_rows + low_row + 0.5) * resolution
    distance = np.hypot(x - pose.x, y - pose.y)
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] <= reach]
    # Neighbouring cells mostly see the same viewpoints, so the tries are spread over all distances.
    step = max(len(order) // _MAX_PLACES, 1)
    for index in order[::step].tolist():
        place = Pose(float(x[index]), float(y[index]), pose.yaw)
        mapper.update(place)
        if not mapper.stuck:
            return place
    return None


def _rest(position: Position, target: Position | None) -> float:
    return 0.0 if target is None else hypot(position[0] - target[0], position[1] - target[1])

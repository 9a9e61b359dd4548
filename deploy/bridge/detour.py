"""A way around places that are banned or fenced off, for when the planner's own choice is one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.distances import shortest_paths
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Position, Status
from common.planners.viewpoint_planner import next_leg

MayEnter = Callable[[Position, Position], bool]

# Edges between allowed places that turn out to be closed, one after the other; more cost time that a decision lacks.
_MAX_TRIES: Final = 20
_REASON: Final = "a way around banned places"


def useful_nodes(mapper: Mapper, target: Position | None) -> NDArray[np.int64]:
    """Return the nodes worth going to: those that observe frontiers and were not visited, and a known target.

    What a visit did not resolve, another one will not either.
    """
    observation = mapper.observe()
    nodes = np.flatnonzero((observation.utility > 0) & ~observation.visited)
    return np.append(nodes, observation.viewpoints) if target is not None and mapper.target_known else nodes


def detour(mapper: Mapper, pose: Pose, target: Position | None, spacing: float, may_enter: MayEnter) -> Plan:
    """Go to the nearest useful viewpoint that can be reached over allowed viewpoints and edges alone.

    With a target, nearness counts the straight rest to the target.

    Args:
        mapper: updated at the pose.
        pose: of the robot.
        target: of navigation, or None.
        spacing: between viewpoints, metres.
        may_enter: whether the robot may drive straight from one position to another.
    """
    if mapper.stuck:
        return Plan(Status.STUCK, reason="according to the map, the robot does not fit where it is")
    edges = _Edges(mapper, may_enter)
    goals = [int(node) for node in useful_nodes(mapper, target) if edges.allowed[node]]
    for _ in range(_MAX_TRIES):
        route = edges.nearest(goals, target)
        if not route:
            break
        closed = next((k for k, leg in enumerate(pairwise(route)) if not edges.may_drive(*leg)), None)
        if closed is not None:
            edges.close(route[closed], route[closed + 1])
            continue
        plan = next_leg(mapper, pose, route, spacing)
        if plan.waypoint is None:
            goals.remove(route[-1])
            continue
        return replace(plan, beacon=mapper.position(route[-1]), reason=_REASON)
    return Plan(Status.UNREACHABLE, reason="every way to what is left is banned or fenced off")


class _Edges:
    """The graph of a mapper without the nodes that are not allowed, and without edges that were closed."""

    def __init__(self, mapper: Mapper, may_enter: MayEnter) -> None:
        self._mapper = mapper
        self._may_enter = may_enter
        places = [tuple(place) for place in mapper.viewpoints.tolist()]
        if mapper.target is not None:
            places.append(mapper.target)
        self.allowed = np.array([may_enter(place, place) for place in places], dtype=np.bool_)
        # The robot may leave the place where it stands.
        self.allowed[mapper.robot] = True
        adjacency = mapper.adjacency
        self._pointer, self._neighbours = adjacency.pointer, adjacency.neighbours
        self._lengths = adjacency.lengths.copy()
        begin = np.repeat(np.arange(len(self._pointer) - 1), np.diff(self._pointer))
        self._lengths[~(self.allowed[begin] & self.allowed[self._neighbours])] = np.inf
        links = mapper.observe().target_links.astype(np.int64)
        self._links = links[self.allowed[links]] if mapper.target_known else links[:0]

    def nearest(self, goals: list[int], target: Position | None) -> list[int]:
        """Return the nodes of the shortest way to the best goal, the robot's first; empty without one."""
        mapper = self._mapper
        distances, before = shortest_paths(self._pointer, self._neighbours, self._lengths, mapper.robot, -1)
        n = len(distances)
        best: tuple[float, list[int]] = (np.inf, [])
        for goal in goals:
            # The target is tied to the graph, and no part of it.
            ends = self._links.tolist() if goal == n else [goal]
            place = mapper.position(goal)
            for end in ends:
                rest = place if goal == n else target
                straight = 0.0 if rest is None else float(np.hypot(*np.subtract(mapper.position(end), rest)))
                cost = float(distances[end]) + straight
                if cost < best[0]:
                    best = cost, [*([n] if goal == n else []), end]
        route = best[1]
        while route and route[-1] != mapper.robot:
            route.append(int(before[route[-1]]))
        return route[::-1]

    def may_drive(self, a: int, b: int) -> bool:
        """Whether the way along an edge is allowed, corners included."""
        places = [self._mapper.position(a), *self._mapper.way(a, b)]
        return all(self._may_enter(start, end) for start, end in pairwise(places))

    def close(self, a: int, b: int) -> None:
        """Take an edge away."""
        if b == len(self._pointer) - 1:
            self._links = self._links[self._links != a]
            return
        for here, there in ((a, b), (b, a)):
            row = slice(int(self._pointer[here]), int(self._pointer[here + 1]))
            self._lengths[row][self._neighbours[row] == there] = np.inf

"""What planners on the viewpoint graph share: candidates, the walk along a path, and a clear end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status, TaskName

# The robot has scanned from a viewpoint once it stood this near to it, in spacings.
ON_VIEWPOINT: Final = 0.25
# A decision changes between equally good choices only for more than this, metres.
TOLERANCE: Final = 1e-6
# Decisions in a row for one waypoint from one place before its viewpoint counts as inaccessible.
MAX_ATTEMPTS: Final = 3


class ScannedViewpoints:
    """The viewpoints that are of no use any more: scanned from, or not to be reached.

    A frontier that a viewpoint still observes after a scan from there is one that this scan could not resolve
    (it was too far, or grazed), and another scan from the same place tells the same. Going there again is how planners
    circle forever, so such viewpoints are goals no more.
    """

    def __init__(self, spacing: float) -> None:
        """Forget everything; `spacing` of the viewpoints in metres tells places apart."""
        self._spacing = spacing
        self._scanned: set[tuple[int, int]] = set()
        self._given_up: set[tuple[int, int]] = set()
        self._asked: tuple[Position, Position] | None = None
        self._attempts = 0

    def note(self, mapper: Mapper, pose: Pose) -> None:
        """Remember the robot's viewpoint when the robot stands on it; the mapper was updated at this pose."""
        viewpoint = mapper.position(mapper.robot)
        near = pose.distance_to(viewpoint) <= ON_VIEWPOINT * self._spacing + TOLERANCE
        # The mapper moves a viewpoint to see what it could not from where it was: that place counts when it says so.
        if near and mapper.observe().visited[mapper.robot]:
            self._scanned.add(self._key(*viewpoint))

    def note_attempt(self, pose: Pose, waypoint: Position, goal: Position) -> None:
        """Count decisions that lead nowhere: after `MAX_ATTEMPTS` the waypoint and the goal are given up."""
        if self._asked == (pose.position, waypoint):
            self._attempts += 1
        else:
            self._asked, self._attempts = (pose.position, waypoint), 1
        if self._attempts >= MAX_ATTEMPTS:
            self._given_up |= {self._key(*waypoint), self._key(*goal)}

    def candidates(self, mapper: Mapper) -> NDArray[np.int64]:
        """Return the nodes that observe frontiers and are not done with, ascending.

        A viewpoint where the mapper does not know the robot to have been is worth a visit, even near one that was
        scanned from: it may be that of another piece, or have moved since.
        """
        observation = mapper.observe()
        useful = np.flatnonzero(observation.utility > 0)
        visited = observation.visited[useful].tolist()
        keys = np.rint(mapper.viewpoints[useful] * (8.0 / self._spacing)).astype(np.int64).tolist()
        left = [
            (x, y) not in self._given_up and not (been and (x, y) in self._scanned)
            for (x, y), been in zip(keys, visited, strict=True)
        ]
        return useful[np.array(left, dtype=np.bool_)]

    def _key(self, x: float, y: float) -> tuple[int, int]:
        scale = 8.0 / self._spacing
        return int(np.rint(x * scale)), int(np.rint(y * scale))


class ViewpointPlanner(ABC):
    """An exploration planner whose waypoints are viewpoints: it chooses a goal, and one edge towards it is a decision.

    Subclasses give the goal; the rest is the same for all of them.
    """

    name: str = ""
    tasks: frozenset[TaskName] = frozenset({"exploration"})

    def __init__(self, config: MappingConfig) -> None:
        """Set up for the mapping that the planner will be given."""
        self.config = config
        self.reset("exploration", None, 0)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; equal seeds give equal episodes.

        Raises:
            ConfigError: the task is not one that this planner does.
        """
        check_task(self.name, self.tasks, task)
        del target
        self.scanned = ScannedViewpoints(self.config.viewpoint_spacing)
        self.random = np.random.default_rng(seed)

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose."""
        if mapper.stuck:
            return Plan(Status.STUCK, reason="no viewpoint can be reached in a straight free line from the robot")
        self.scanned.note(mapper, pose)
        candidates = self.scanned.candidates(mapper)
        if not len(candidates):
            return nothing_left(mapper)
        stops = self.choose(mapper, pose, candidates, mapper.viewpoints)
        if not stops:
            return Plan(Status.COMPLETE, reason="no viewpoint that still observes frontiers leads anywhere new")
        plan = lead_to(mapper, pose, stops, self.config.viewpoint_spacing)
        if plan.waypoint is not None:
            self.scanned.note_attempt(pose, plan.waypoint, mapper.position(stops[0]))
        return plan

    @abstractmethod
    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the nodes to visit, the next goal first; empty when none is worth going to.

        Args:
            mapper: updated at the pose.
            pose: where the robot stands.
            candidates: nodes that observe frontiers and were not scanned from, at least one.
            positions: of all viewpoints, metres, shape (n, 2).
        """


def check_task(name: str, tasks: frozenset[TaskName], task: TaskName) -> None:
    """Raise ConfigError when a planner does not do a task."""
    if task not in tasks:
        raise ConfigError(
            f"planner {name!r} does {' and '.join(sorted(tasks))}, not {task}: choose another planner or task"
        )


def lead_to(mapper: Mapper, pose: Pose, stops: list[int], spacing: float) -> Plan:
    """Return the plan that goes one edge towards the first stop; see `next_leg` for a robot beside its viewpoint."""
    route = [mapper.robot]
    for stop in stops:
        route += mapper.path(route[-1], stop)[1:]
    plan = next_leg(mapper, pose, route, spacing)
    if plan.waypoint is None:
        return Plan(Status.COMPLETE, reason="the robot is at the only viewpoint left to visit")
    useful = mapper.observe().utility
    # The number behind those of the viewpoints is the target's.
    goal = next((stop for stop in stops if stop == len(useful) or useful[stop]), stops[0])
    return replace(plan, beacon=mapper.position(goal))


def next_leg(mapper: Mapper, pose: Pose, route: list[int], spacing: float) -> Plan:
    """Return the plan that drives one edge along a route of nodes that begins at the robot's viewpoint.

    A robot beside its viewpoint cuts the corner where the next place of the route is in sight and near enough. One
    that has stopped almost on its viewpoint, as real ones do, can be a little too far for the longest edge: it drives
    as far as it may. Otherwise it drives onto its own viewpoint first. Without a place to go the plan has no waypoint.
    """
    places = [mapper.position(node) for node in route]
    beside = pose.distance_to(places[0])
    if len(route) > 1:
        way = mapper.way(route[0], route[1])
        if beside > TOLERANCE:
            way = _cut_corner(mapper, pose, way, LONGEST_EDGE * spacing, almost=beside <= ON_VIEWPOINT * spacing)
        if way:
            return Plan(Status.GOING, waypoint=way[-1], via=way[:-1], path=places[2:])
    if beside <= TOLERANCE:
        return Plan(Status.COMPLETE)
    way = mapper.way_home()
    return Plan(Status.GOING, waypoint=way[-1], via=way[:-1], path=places[1:])


def _cut_corner(mapper: Mapper, pose: Pose, way: list[Position], longest: float, *, almost: bool) -> list[Position]:
    """Return how a robot beside its viewpoint drives the way from there, empty where it has to go there first.

    Args:
        mapper: updated at the pose.
        pose: where the robot stands.
        way: from the robot's viewpoint, metres, that left out.
        longest: leg, metres.
        almost: the robot stands almost on its viewpoint.
    """
    for k in range(len(way) - 1, -1, -1):
        there = way[k]
        distance = pose.distance_to(there)
        if distance > longest + TOLERANCE and almost and k == len(way) - 1:
            share = longest / distance
            there = (pose.x + share * (there[0] - pose.x), pose.y + share * (there[1] - pose.y))
        if pose.distance_to(there) <= longest + TOLERANCE and mapper.segment_free(pose.position, there):
            return [there, *way[k + 1 :]]
    return []


def nothing_left(mapper: Mapper, status: Status = Status.COMPLETE) -> Plan:
    """Return the plan of a robot that no viewpoint is worth going to for, with the reason; it can be cut off from some.

    Args:
        mapper: updated where the robot stands.
        status: of a robot that is not cut off.
    """
    if mapper.cut_off is not None:
        x, y = mapper.cut_off
        where = f"from ({x:.1f}, {y:.1f}) m, where the robot came from"
        return Plan(Status.STUCK, reason=f"more is left to see {where}, but its way back is closed")
    useful = int(np.count_nonzero(mapper.observe().utility))
    if not useful:
        return Plan(status, reason="no reachable viewpoint observes a frontier")
    used = f"the {useful} viewpoints that still observe frontiers have all been used for a scan"
    return Plan(status, reason=f"{used}: nothing more can be seen from them")

"""What navigation planners share: the target, statuses, and waypoints that the nominal protocol allows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from math import ceil
from typing import Final

import numpy as np

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.raycast import SUBCELLS
from common.mapping.standing import MARGIN_REACH
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.navigation.following import PathFollower
from common.planners.navigation.graph_search import NO_WAY
from common.planners.navigation.optimistic_graph import OptimisticGraph
from common.planners.navigation.possible_space import possible_way
from common.planners.viewpoint_planner import MAX_ATTEMPTS, ON_VIEWPOINT, TOLERANCE, check_task, next_leg

# Decisions in a row from one place, whatever they were, before the robot counts as stuck.
MAX_STANDSTILL: Final = 12
# Paths that one decision plans before it gives up: each one after the first knows one more doubtful cell.
MAX_PATHS: Final = 12


class NavigationPlanner(ABC):
    """A planner that goes to a target: it arrives, drives straight where it can, and asks its subclass otherwise."""

    name: str = ""
    tasks: frozenset[TaskName] = frozenset({"navigation"})

    def __init__(self, config: MappingConfig, *, arrival_radius: float = 0.5) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            arrival_radius: metres from the target at which the planner says that it has arrived; who runs it may be
                content earlier.

        Raises:
            ConfigError: the radius is not above 0.
        """
        if not arrival_radius > 0.0:
            raise ConfigError(f"planner {self.name!r}: arrival_radius must be above 0 m, got {arrival_radius}")
        self.config = config
        self._arrival_radius = arrival_radius
        self._longest = LONGEST_EDGE * config.viewpoint_spacing
        self._target: Position | None = None

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; equal seeds give equal episodes.

        Raises:
            ConfigError: the task is not navigation, or the target is missing or not finite.
        """
        check_task(self.name, self.tasks, task)
        if target is None or not np.isfinite(target).all():
            raise ConfigError(
                f"planner {self.name!r} needs a target, (x, y) in metres, got {target}: pass one to reset"
            )
        self._target = (float(target[0]), float(target[1]))
        self._asked: tuple[Position, Position] | None = None
        self._attempts = 0
        self._standstill = 0
        self.begin(self._target, seed)

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose.

        Raises:
            ConfigError: there was no reset yet.
        """
        target = self._target
        if target is None:
            raise ConfigError(f"planner {self.name!r} has no target yet: call reset('navigation', target, seed) first")
        if pose.distance_to(target) <= self._arrival_radius:
            return Plan(Status.COMPLETE, reason="the robot has arrived at the target")
        straight = pose.distance_to(target) <= self._longest and mapper.segment_free(pose.position, target)
        if straight and not self._tried(pose.position, target):
            return self._go(pose, Plan(Status.GOING, waypoint=target, beacon=target, reason="the target is visible"))
        if mapper.stuck:
            return Plan(Status.STUCK, reason="no viewpoint can be reached in a straight free line from the robot")
        plan = self.decide(mapper, pose, target)
        return self._go(pose, plan)

    @abstractmethod
    def begin(self, target: Position, seed: int) -> None:
        """Forget everything and get ready for a target, metres."""

    @abstractmethod
    def decide(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Decide where to go; the target is not reached and cannot be driven to in one straight leg."""

    @abstractmethod
    def give_up(self, waypoint: Position) -> None:
        """Leave out a waypoint that the robot failed to reach `MAX_ATTEMPTS` times from one place."""

    def _tried(self, position: Position, waypoint: Position) -> bool:
        return self._asked == (position, waypoint) and self._attempts >= MAX_ATTEMPTS

    def _go(self, pose: Pose, plan: Plan) -> Plan:
        """Count decisions that lead nowhere."""
        if plan.waypoint is None:
            return plan
        moved = self._asked is None or self._asked[0] != pose.position
        self._standstill = 1 if moved else self._standstill + 1
        if self._standstill > MAX_STANDSTILL:
            return Plan(Status.STUCK, reason=f"{MAX_STANDSTILL} decisions in a row did not move the robot")
        if self._asked == (pose.position, plan.waypoint):
            self._attempts += 1
        else:
            self._asked, self._attempts = (pose.position, plan.waypoint), 1
        if self._attempts >= MAX_ATTEMPTS:
            self.give_up(plan.waypoint)
        return plan


class GraphNavigator(NavigationPlanner):
    """A navigation planner on the viewpoint graph, unknown space taken as free: subclasses search the path.

    When no path is left over which the robot has not looked around yet, although the robot might fit through to the
    target, what is known does not show from any viewpoint how. Then the robot drives on from cell to cell as far as it
    knows, looks, and holds for an obstacle what stays unknown right before it.
    """

    graph: OptimisticGraph

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything; there is no chance in a search, so the seed plays no part."""
        del seed
        self.graph = OptimisticGraph(self.config, target)
        self._follower = PathFollower(self.config, self.graph.world)
        self._path: list[int] = []
        self._reach = ceil((self.config.robot_radius + MARGIN_REACH) / self.config.resolution)

    def decide(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Go one edge along a shortest path."""
        if self._asked is not None:
            self._follower.note_stop(pose.distance_to(self._asked[1]))
        viewpoint = mapper.position(mapper.robot)
        on_viewpoint = pose.distance_to(viewpoint) <= ON_VIEWPOINT * self.config.viewpoint_spacing
        start = self.graph.update(mapper, scanned=on_viewpoint)
        length, self._path = self.search(start)
        stands_on = len(self._path) > 1 and pose.distance_to(self.graph.position(self._path[1])) <= TOLERANCE
        if stands_on and not on_viewpoint:
            # It stands where the next viewpoint would be if more were free than is: there is none, as the mapper knows.
            self.graph.close(self._path[1])
            start = self.graph.update(mapper, scanned=on_viewpoint)
            length, self._path = self.search(start)
        if length >= NO_WAY:
            return self._look_closer(mapper, pose, target)
        plan = self._first_leg(mapper, pose, on_viewpoint)
        if plan.waypoint == target:
            plan = short_of_margin(mapper, pose, plan)
        metres = length / SUBCELLS * self.config.resolution
        ahead = [self.graph.position(vertex) for vertex in self._path[2:]]
        return replace(plan, beacon=target, path=[*ahead, target], reason=plan.reason or f"{metres:.1f} m at best")

    def give_up(self, waypoint: Position) -> None:
        """Close the next viewpoint of the path for the rest of the episode, or the last leg to the target."""
        if len(self._path) > 1:
            self.graph.close(self._path[1])
        elif self._path:
            self.graph.close_leg(self._path[0])
        else:
            self.graph.world.doubt(waypoint, always=True)

    @abstractmethod
    def search(self, start: int) -> tuple[int, list[int]]:
        """Return length and vertices of a shortest path over the graph from the robot's vertex.

        The length is in subcells, as in `GoalGraph`; it is `NO_WAY` and the path is empty when there is none.
        """

    def _first_leg(self, mapper: Mapper, pose: Pose, on_viewpoint: bool) -> Plan:
        """Return the plan that drives the first edge of the path, or to the robot's viewpoint where that is not known.

        A robot that has not been on its viewpoint yet cuts the corner where the next one is in sight.
        """
        path = self._path
        if len(path) > 1 and not on_viewpoint:
            place = self.graph.position(path[1])
            if pose.distance_to(place) <= self._longest + TOLERANCE and mapper.segment_free(pose.position, place):
                return Plan(Status.GOING, waypoint=place)
        node = self.graph.known_node(path[1]) if len(path) > 1 else len(mapper.viewpoints)
        route = [mapper.robot, node] if mapper.joined(mapper.robot, node) else [mapper.robot]
        return next_leg(mapper, pose, route, self.config.viewpoint_spacing)

    def _look_closer(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Drive as far as is known on the way that cells would still allow; there is none over viewpoints."""
        graph, world = self.graph, self.graph.world
        for _ in range(MAX_PATHS):
            cells = graph.viewpoints.cells
            way = possible_way(world, cells.clear.reshape(-1, cells.width), pose.position, target, self._reach)
            if way is None:
                return Plan(Status.UNREACHABLE, reason=unreachable(mapper, target))
            if as_near_as_possible(pose, way, target, self._follower.near):
                return Plan(Status.COMPLETE, reason="the robot is as near to the target as it fits")
            waypoint = self._follower.reach(mapper, pose, way)
            if waypoint is not None:
                return Plan(Status.GOING, waypoint=waypoint, beacon=target, path=way, reason="looking more closely")
            graph.bring_up_to_date(mapper, mapper.position(mapper.robot))
        return Plan(Status.STUCK, reason=f"none of {MAX_PATHS} paths begins in space that is known to be clear")


def as_near_as_possible(pose: Pose, path: list[Position], target: Position, near: float) -> bool:
    """Whether the robot stands at the end of a path that ends before the target; ``near``, metres, is close enough."""
    return len(path) == 1 and path[0] != target and pose.distance_to(path[0]) <= max(near, TOLERANCE)


def short_of_margin(mapper: Mapper, pose: Pose, plan: Plan) -> Plan:
    """Return a plan that leads to a target without its last leg where that has less room than the robot needs."""
    assert plan.waypoint is not None
    before = plan.via[-1] if plan.via else pose.position
    if mapper.segment_free(before, plan.waypoint):
        return plan
    if pose.distance_to(before) <= TOLERANCE:
        return Plan(Status.COMPLETE, reason="the robot is as near to the target as it fits")
    return replace(plan, waypoint=before, via=plan.via[:-1])


def unreachable(mapper: Mapper, target: Position) -> str:
    """Say why a target cannot be reached."""
    if mapper.belief.at(target) > 0:
        return f"the target ({target[0]:.2f}, {target[1]:.2f}) lies in an obstacle"
    return f"obstacles close every way to the target ({target[0]:.2f}, {target[1]:.2f}), unknown space taken as free"

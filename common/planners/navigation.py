"""What navigation planners share: the target, statuses, and waypoints that the nominal protocol allows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

import numpy as np

from common.config.schema import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.grid_search import NO_WAY, UNITS
from common.planners.lattice import MAX_ATTEMPTS, ON_VIEWPOINT, check_task, first_legs
from common.planners.optimistic import OptimisticLattice

# Decisions in a row from one place, whatever they were, before the robot counts as stuck.
MAX_STANDSTILL: Final = 12


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
            return self._go(pose, Plan(Status.GOING, waypoint=target, beacon=target, reason="the target is in sight"))
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
        """Leave out a waypoint that the robot was sent to in vain, `MAX_ATTEMPTS` times from one place."""

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


class LatticeNavigator(NavigationPlanner):
    """A navigation planner on the viewpoint lattice, unknown space taken as free: subclasses search the path."""

    lattice: OptimisticLattice

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything; there is no chance in a search, so the seed plays no part."""
        del seed
        self.lattice = OptimisticLattice(self.config.viewpoint_spacing, target)

    def decide(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Go one edge along a shortest path."""
        viewpoint = mapper.position(mapper.robot)
        on_viewpoint = pose.distance_to(viewpoint) <= ON_VIEWPOINT * self.config.viewpoint_spacing
        start = self.lattice.update(mapper.belief, viewpoint, scanned=on_viewpoint)
        units, path = self.search(start)
        if units >= NO_WAY:
            return Plan(Status.UNREACHABLE, reason=unreachable(mapper, target))
        places = [self.lattice.position(node) for node in path]
        # The robot's node as the mapper gives it, and the target as it was given: without the lattice's rounding.
        places[0] = viewpoint
        places = first_legs(mapper, pose, [*places, target], self.config.viewpoint_spacing)
        metres = units / UNITS * self.config.viewpoint_spacing
        return Plan(Status.GOING, waypoint=places[0], beacon=target, path=places[1:], reason=f"{metres:.1f} m at best")

    def give_up(self, waypoint: Position) -> None:
        """Close the viewpoint for the rest of the episode."""
        self.lattice.close(waypoint)

    @abstractmethod
    def search(self, start: int) -> tuple[int, list[int]]:
        """Return length in units and lattice points of a shortest path over the lattice's edges from the robot's.

        The length is `NO_WAY` and the path is empty when there is none.
        """


def unreachable(mapper: Mapper, target: Position) -> str:
    """Say why a target cannot be reached."""
    if mapper.belief.at(target) > 0:
        return f"the target ({target[0]:.2f}, {target[1]:.2f}) lies in an obstacle"
    return f"obstacles close every way to the target ({target[0]:.2f}, {target[1]:.2f}), unknown space taken as free"

"""What exploration planners with random samples share: where the robot stands, what a place gains, a clear end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.viewpoints import LONGEST_EDGE
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.exploration.rrt import free_box
from common.planners.viewpoint_planner import ON_VIEWPOINT, ScannedViewpoints, check_task, lead_to, next_leg
from common.planners.visibility import at_ease, unknown_in_sight

# Edges are this much shorter than the longest waypoint, so that rounding cannot make one too far.
MARGIN: Final = 1.0 - 1e-5
# Least distance between sampled places, spacings: places on top of each other see the same.
SPREAD: Final = 0.5

Corner = NDArray[np.float64]


class SamplingPlanner(ABC):
    """An exploration planner on random places in known clear space, which go where unknown area can be seen.

    A place gains nothing when the robot was next to it since it last learned of any cell: the scan from there told
    nothing, and would tell the same again. No publication says so; without it a robot whose sensor cannot resolve what
    the belief promises, for example over a drop, would go there forever.

    Random places seldom lie in doors that a robot barely fits through. So one with a radius does not end before it has
    been at the viewpoints that still observe frontiers, the nearest first. No publication says that, either. The robot
    drives to the end of such a way before the planner decides again: on the way it may pass places without room for
    straight lines, which it would leave for where it came from, for ever.
    """

    name: str = ""
    tasks: frozenset[TaskName] = frozenset({"exploration"})

    def __init__(self, config: MappingConfig, min_gain: float) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            min_gain: a place that sees less unknown area than this sees nothing, square metres.
        """
        self.config = config
        self.reach = LONGEST_EDGE * config.viewpoint_spacing * MARGIN
        self.spread = SPREAD * config.viewpoint_spacing
        self.min_gain = min_gain
        self.reset("exploration", None, 0)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; equal seeds give equal episodes.

        Raises:
            ConfigError: the task is not exploration.
        """
        check_task(self.name, self.tasks, task)
        del target
        self.random = np.random.default_rng(seed)
        self._scanned = ScannedViewpoints(self.config.viewpoint_spacing)
        self._visiting: Position | None = None
        self._barren: list[Position] = []
        self._known_cells = -1
        self.begin()

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose."""
        if not mapper.segment_free(pose.position, pose.position):
            return Plan(Status.STUCK, reason="the robot is not in a cell that is known to be free")
        if self._visiting is not None:
            plan = self._visit_viewpoint(mapper, pose, self._visiting)
            if plan is not None:
                return plan
        box = free_box(mapper.clear)
        if box is None or not at_ease(mapper.clear, np.array([pose.position]))[0]:
            return self._leave_margin(mapper, pose)
        if mapper.belief.known_cells != self._known_cells:
            self._known_cells = mapper.belief.known_cells
            self._barren.clear()
        self._barren.append(pose.position)
        plan = self.decide(mapper, pose, *box)
        if plan.status is Status.COMPLETE and self.config.robot_radius > 0.0:
            return self._visit_viewpoint(mapper, pose) or plan
        return plan

    def _visit_viewpoint(self, mapper: Mapper, pose: Pose, beside: Position | None = None) -> Plan | None:
        """Lead to the nearest viewpoint that observes frontiers and was not scanned from; None without one.

        Args:
            mapper: updated at the pose.
            pose: where the robot stands.
            beside: only a viewpoint beside this place counts, metres.
        """
        self._visiting = None
        if mapper.stuck:
            return None
        self._scanned.note(mapper, pose)
        candidates = self._scanned.candidates(mapper)
        if beside is not None:
            away = np.hypot(*(mapper.viewpoints[candidates] - np.array(beside)).T)
            candidates = candidates[away <= ON_VIEWPOINT * self.config.viewpoint_spacing]
        distances = mapper.distances(mapper.robot)[candidates]
        if not np.isfinite(distances).any():
            return None
        goal = int(candidates[np.argmin(distances)])
        plan = lead_to(mapper, pose, [goal], self.config.viewpoint_spacing)
        if plan.waypoint is None:
            return None
        self._visiting = mapper.position(goal)
        self._scanned.note_attempt(pose, plan.waypoint, self._visiting)
        return plan

    def _leave_margin(self, mapper: Mapper, pose: Pose) -> Plan:
        """Lead a robot that stands too near to obstacles for straight lines to the nearest viewpoint where it may."""
        if not mapper.stuck:
            distances = mapper.distances(mapper.robot)[: len(mapper.viewpoints)]
            distances[~at_ease(mapper.clear, mapper.viewpoints)] = np.inf
            goal = int(np.argmin(distances))
            if np.isfinite(distances[goal]):
                route = mapper.path(mapper.robot, goal)
                plan = next_leg(mapper, pose, route, self.config.viewpoint_spacing)
                if plan.waypoint is not None:
                    return replace(plan, beacon=mapper.position(goal))
        return Plan(Status.STUCK, reason="no place with room for straight lines can be reached from the robot")

    @abstractmethod
    def begin(self) -> None:
        """Forget everything."""

    @abstractmethod
    def decide(self, mapper: Mapper, pose: Pose, low: Corner, high: Corner) -> Plan:
        """Decide; all clear cells lie between two corners, metres, and the robot stands in one."""

    def gains(self, mapper: Mapper, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unknown area that each place sees, square metres; places in metres, shape (n, 2)."""
        areas = unknown_in_sight(mapper, places, self.config.sensor_range)
        areas[areas < self.min_gain] = 0.0
        for x, y in self._barren:
            areas[np.hypot(places[:, 0] - x, places[:, 1] - y) < self.spread] = 0.0
        return areas

    def samples(self, count: int, low: Corner, high: Corner) -> NDArray[np.float64]:
        """Return random positions between two corners, metres, shape (count, 2)."""
        return low + self.random.random((count, 2)) * (high - low)

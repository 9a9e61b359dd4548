"""What is wrong with the robot's inputs, map and planner, and which of it holds the robot."""

from __future__ import annotations

from typing import Final

from common.mapping.mapper import Mapper
from deploy.bridge.legs import free_in
from deploy.bridge.map_source import MapSource
from deploy.bridge.outcome import Course
from deploy.safety.health import Fault, FaultKind, HealthMonitor

# Faults that a decision can mend; all others hold the robot until they are over.
_MENDED_BY_PLANNING: Final = frozenset({FaultKind.WAYPOINT_OCCUPIED, FaultKind.POLICY_ERROR})


class Checkup:
    """Puts together what the health monitor finds and what the map says of itself.

    Attributes:
        faults: of this pass, the most telling first.
    """

    def __init__(self, health: HealthMonitor, robot_map: MapSource) -> None:
        """Find nothing yet; both are fed by others."""
        self._health = health
        self._map = robot_map
        self._version = -1
        self.faults: list[Fault] = []

    @property
    def holding(self) -> Fault | None:
        """The first fault that holds the robot, or None."""
        return next((fault for fault in self.faults if fault.kind not in _MENDED_BY_PLANNING), None)

    @property
    def waypoint_occupied(self) -> bool:
        """Whether something stands where the robot is going."""
        return any(fault.kind is FaultKind.WAYPOINT_OCCUPIED for fault in self.faults)

    def note_map(self, version: int, now: float) -> None:
        """Hear which version of the map there is, which changes with all that goes into it."""
        if version != self._version:
            self._version = version
            self._health.updated_map(now)

    def check(self, mapper: Mapper | None, course: Course | None, now: float) -> None:
        """Look for faults, at a moment when the robot is on a course or stands."""
        waypoint = course.waypoint if course else None
        is_free = free_in(mapper, with_room=course.with_room) if mapper is not None and course else None
        faults = self._health.check(now, waypoint=waypoint, is_free=is_free)
        statistics = self._map.statistics
        if statistics.outdated:
            # Messages of TF do come, and it matters which does not.
            faults = [
                Fault(fault.kind, f"{fault.reason}, {statistics.outdated}")
                if fault.kind is FaultKind.POSE_STALE
                else fault
                for fault in faults
            ]
        if statistics.misplaced:
            # It takes nothing in for that.
            others = [fault for fault in faults if fault.kind is not FaultKind.MAP_STALE]
            faults = [Fault(FaultKind.MAP_MISPLACED, statistics.misplaced), *others]
        self.faults = faults

    def planner_failed(self, error: Exception) -> None:
        """Note that no planner could decide."""
        self._health.policy_failed(error)
        self.faults.append(Fault(FaultKind.POLICY_ERROR, str(error)))

    def planner_decided(self) -> None:
        """Note that a planner has decided, by which what a decision can mend is over."""
        self._health.policy_decided()
        self.faults = [fault for fault in self.faults if fault.kind not in _MENDED_BY_PLANNING]

"""What can be wrong with the bridge's inputs and decisions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class FaultKind(StrEnum):
    """What is wrong."""

    SENSOR_STALE = "sensor_stale"
    """No scan, cloud or map came for `safety.scan_timeout`."""
    SENSOR_FROZEN = "sensor_frozen"
    """Scans or clouds come, but tell nothing new: their stamp or, while the robot moves, their content stands still."""
    SENSOR_BLIND = "sensor_blind"
    """Scans or clouds come, but too few of their beams or points tell anything."""
    SENSOR_INVALID = "sensor_invalid"
    """Scans or clouds come, but contradict themselves, such as by angles that do not fit the number of beams."""
    POSE_STALE = "pose_stale"
    """No pose came for `safety.pose_timeout`."""
    POSE_FROZEN = "pose_frozen"
    """Poses come, but their stamp stands still, or the pose itself does while the robot is told to move."""
    CLOCK_SET_BACK = "clock_set_back"
    """The robot's clock was set back; what was stamped before is forgotten."""
    MAP_STALE = "map_stale"
    """The belief took nothing in for `safety.scan_timeout` although messages came."""
    POSE_JUMP = "pose_jump"
    """The pose moved faster than the robot can."""
    MAP_MISPLACED = "map_misplaced"
    """After a jump or a silence of the pose, what the robot sees does not fit its map, or is being compared; or its
    SLAM began a new map."""
    POLICY_ERROR = "policy_error"
    """The planner failed."""
    WAYPOINT_OCCUPIED = "waypoint_occupied"
    """The waypoint is no longer free."""
    GEOFENCE = "geofence"
    """The robot or its waypoint is outside the fence."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: what.
        reason: in words for the operator, with the figures.
    """

    kind: FaultKind
    reason: str

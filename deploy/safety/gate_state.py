"""What the watchdog says about itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class GateMode(StrEnum):
    """What the watchdog does with the velocity topic, in the order of precedence."""

    EMERGENCY_STOP = "emergency_stop"
    """Zeros until the latch is released."""
    OVERRIDDEN = "overridden"
    """An operator moves the sticks: zeros for a moment, then silence, so that theirs are the only velocities."""
    BRIDGE_GONE = "bridge_gone"
    """Zeros for `safety.zero_for`, then the watchdog ends."""
    BRIDGE_SILENT = "bridge_silent"
    """Zeros: the bridge lives but says nothing."""
    RIVAL = "rival"
    """Zeros: the watchdog of another bridge commands the same robot."""
    SENSOR_STALE = "sensor_stale"
    """Zeros: no scan, cloud or map came for too long."""
    POSE_STALE = "pose_stale"
    """Zeros: no pose came for too long."""
    OUTSIDE = "outside"
    """Zeros: the robot is outside `safety.geofence`."""
    HELD = "held"
    """Zeros: the bridge asked for them."""
    COMMAND_STALE = "command_stale"
    """Zeros: the bridge drives, but its last command is too old."""
    CLEAR = "clear"
    """The bridge's commands pass, or, when the robot's own stack drives, nothing is sent."""


def emergency_reason(reason: str) -> str:
    """Return in words for the operator why the emergency stop is latched."""
    return f"emergency stop ({reason}) until it is released"


@dataclass(frozen=True, slots=True)
class GateState:
    """The state of the watchdog.

    Attributes:
        mode: what it does.
        reason: why, in words for the operator.
        emergency_stop: the stop is latched.
        overridden: an operator has taken over.
        sensor_age: seconds since the last scan, cloud or map; None before the first.
        pose_age: seconds since the last pose; None before the first.
        linear: last velocity sent, m/s.
        angular: last velocity sent, rad/s.
        clipped: the last command was beyond the limits.
        heard: somebody listens to the velocities, with the same type; true where there is no such topic.
        alive: the watchdog process runs and reports.
    """

    mode: GateMode
    reason: str
    emergency_stop: bool = False
    overridden: bool = False
    sensor_age: float | None = None
    pose_age: float | None = None
    linear: float = 0.0
    angular: float = 0.0
    clipped: bool = False
    heard: bool = True
    alive: bool = True

    @property
    def in_other_hands(self) -> bool:
        """Whether somebody else has the robot: an operator with a joystick, or another bridge."""
        return self.alive and self.mode in {GateMode.OVERRIDDEN, GateMode.RIVAL}

    @property
    def clear(self) -> bool:
        """Whether the robot may move by the bridge's will."""
        return self.alive and self.mode is GateMode.CLEAR

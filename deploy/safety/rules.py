"""What the watchdog sends: rules without clock, bus or process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from deploy.config import SafetyConfig
from deploy.safety.awaited import Awaited
from deploy.safety.gate_state import GateMode, emergency_reason
from deploy.safety.takeover import Takeover

STOP_ALL: Final = 2
GO: Final = 0
# Stops the robot on whatever way it was when the operator took it over; then only the operator's velocities count.
_TAKEOVER_ZEROS: Final = 0.3
# Another watchdog that was not heard for so long, seconds, has ended; it reports once a second.
_RIVAL: Final = 2.5


@dataclass(frozen=True, slots=True)
class Decision:
    """What to send now.

    Attributes:
        mode: which rule decided.
        reason: in words for the operator; it changes only when something changes.
        velocity: (m/s, rad/s) to send, or None for silence.
        stop: value for the CMU stack's `/stop`.
        clipped: the command was beyond the limits.
        ended: the watchdog's work is over.
    """

    mode: GateMode
    reason: str
    velocity: tuple[float, float] | None
    stop: int
    clipped: bool = False
    ended: bool = False


class GateRules:
    """The watchdog's knowledge and its rules, in the order of `GateMode`.

    All times are seconds of one monotonic clock, given by the caller.
    """

    def __init__(
        self,
        config: SafetyConfig,
        sensor: str,
        now: float,
        emergency_stop: str = "",
        *,
        drives: bool,
        awaited: Awaited = Awaited(),  # noqa: B008  (immutable)
    ) -> None:
        """Start without having heard anything.

        Args:
            config: limits of speed and of silence.
            sensor: what the map is made from; a `grid` may come once and no more.
            now: seconds.
            emergency_stop: reason of a stop that is latched already.
            drives: the bridge sends velocities; otherwise the robot's own stack drives.
            awaited: where sensor and pose are waited for.
        """
        self._config = config
        self._drives = drives
        self._awaited = awaited
        self._sensor_name = {"scan": "scan", "points": "point cloud", "grid": "map"}[sensor]
        self._latched = sensor == "grid"
        self._takeover = Takeover(config)
        self._started = now
        self._bridge = now
        self._gone: tuple[float, str] | None = None
        self._command: tuple[float, float, float] | None = None
        self._hold = ""
        self._emergency = emergency_stop
        self._overridden_since: float | None = None
        self._finishing: float | None = None
        self.sensor_time: float | None = None
        self.pose_time: float | None = None
        self.rival_time: float | None = None
        """When another bridge was last heard to command this robot."""
        self.outside = ""
        """Where the robot stands outside the geofence; empty while it is inside."""

    @property
    def emergency_stop(self) -> str:
        """Reason of the latched stop; empty while there is none."""
        return self._emergency

    @property
    def bridge_gone(self) -> bool:
        """Whether the bridge is dead."""
        return self._gone is not None

    @property
    def gone_since(self) -> float | None:
        """When the bridge died; None while it lives."""
        return None if self._gone is None else self._gone[0]

    def overridden(self, now: float) -> bool:
        """Whether an operator has taken over."""
        return self._takeover.active(now)

    def bridge_lives(self, sent: float) -> None:
        """The bridge said anything at all, at the time `sent`."""
        self._bridge = max(self._bridge, sent)

    def command(self, sent: float, linear: float, angular: float) -> None:
        """The bridge commanded a velocity; that ends a hold."""
        self._command = sent, linear, angular
        self._hold = ""

    def hold(self, reason: str) -> None:
        """The bridge asked for standstill."""
        self._hold = reason or "no reason given"
        self._command = None

    def resume(self) -> None:
        """The bridge ended a hold."""
        self._hold = ""

    def bridge_died(self, now: float, reason: str) -> None:
        """The bridge's process is gone."""
        if self._gone is None:
            self._gone = now, reason

    def finish(self, now: float) -> None:
        """The bridge ends in order."""
        self._finishing = now

    def latch(self, reason: str) -> None:
        """An emergency stop arrived."""
        self._emergency = self._emergency or reason

    def release(self) -> None:
        """The operator released the emergency stop."""
        self._emergency = ""

    def joystick(self, axes: Sequence[float], now: float) -> None:
        """A joystick message arrived."""
        self._takeover.heard(axes, now)

    def decide(self, now: float) -> Decision:
        """Say what to send now."""
        overridden = self.overridden(now)
        if not overridden:
            self._overridden_since = None
        elif self._overridden_since is None:
            self._overridden_since = now
        ended = self._ended(now)
        fault = self._fault(now)
        if fault is None:
            velocity, clipped = self._permitted()
            reason = "velocities pass" if self._drives else "the robot's own stack drives"
            return Decision(GateMode.CLEAR, reason, velocity, GO, clipped, ended)
        mode, reason = fault
        if mode is GateMode.OVERRIDDEN:
            # The stack that hears /stop drives by the same sticks.
            recent = self._overridden_since is not None and now - self._overridden_since < _TAKEOVER_ZEROS
            zeros = (0.0, 0.0) if recent and self._drives else None
            return Decision(mode, reason, zeros, GO, ended=ended)
        return Decision(mode, reason, (0.0, 0.0), STOP_ALL, ended=ended)

    def _fault(self, now: float) -> tuple[GateMode, str] | None:
        config = self._config
        if self._emergency:
            return GateMode.EMERGENCY_STOP, emergency_reason(self._emergency)
        if self._takeover.active(now):
            return GateMode.OVERRIDDEN, "an operator moves the sticks"
        if self._gone is not None:
            return GateMode.BRIDGE_GONE, self._gone[1]
        if self._finishing is not None:
            return GateMode.HELD, "the bridge ends"
        if now - self._bridge > config.bridge_timeout:
            return GateMode.BRIDGE_SILENT, f"the bridge said nothing for {config.bridge_timeout:g} s"
        if self.rival_time is not None and now - self.rival_time <= _RIVAL:
            return GateMode.RIVAL, (
                "another bridge commands this robot too, on the same topic for velocities or stops: end one of the two"
            )
        for mode, what, last, limit, where in (
            (GateMode.SENSOR_STALE, self._sensor_name, self.sensor_time, config.scan_timeout, self._awaited.sensor),
            (GateMode.POSE_STALE, "pose", self.pose_time, config.pose_timeout, self._awaited.pose),
        ):
            if last is None:
                return mode, f"no {what} received yet{where}"
            # A map comes when it changes, perhaps only once.
            if now - last > limit and not (self._latched and mode is GateMode.SENSOR_STALE):
                return mode, f"no {what} for {limit:g} s"
        if self.outside:
            return GateMode.OUTSIDE, f"the robot is outside the geofence, seen at {self.outside}"
        if self._hold:
            return GateMode.HELD, self._hold
        if self._drives:
            return self._wish_fault(now)
        return None

    def _wish_fault(self, now: float) -> tuple[GateMode, str] | None:
        if self._command is None:
            return GateMode.COMMAND_STALE, "the bridge has commanded no velocity"
        sent, linear, angular = self._command
        if now - sent > self._config.bridge_timeout:
            return GateMode.COMMAND_STALE, f"the bridge's last velocity is older than {self._config.bridge_timeout:g} s"
        if not (isfinite(linear) and isfinite(angular)):
            return GateMode.COMMAND_STALE, f"the bridge commanded a velocity that is not finite: {linear}, {angular}"
        return None

    def _permitted(self) -> tuple[tuple[float, float] | None, bool]:
        if not self._drives or self._command is None:
            return None, False
        _, linear, angular = self._command
        return clip(linear, angular, self._config)

    def _ended(self, now: float) -> bool:
        if self._finishing is not None:
            return now - self._finishing >= _TAKEOVER_ZEROS
        return self._gone is not None and now - self._gone[0] >= self._config.zero_for


def clip(linear: float, angular: float, config: SafetyConfig) -> tuple[tuple[float, float], bool]:
    """Scale a velocity down to the limits; both parts alike, so that the robot stays on its arc.

    Returns:
        The velocity, and whether it was beyond the limits.
    """
    excess = max(abs(linear) / config.speed_limit, abs(angular) / config.turn_limit)
    if excess <= 1.0:
        return (linear, angular), False
    limit, turn = config.speed_limit, config.turn_limit
    # Rounding must not put a quotient a hair above the limit.
    return (
        max(-limit, min(limit, linear / excess)),
        max(-turn, min(turn, angular / excess)),
    ), True

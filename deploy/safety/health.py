"""Faults of the bridge's inputs and decisions that must stop the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from math import hypot, isfinite

from common.geometry import Pose
from deploy.config import Point, SafetyConfig
from deploy.safety.geofence import Geofence


class FaultKind(StrEnum):
    """What is wrong."""

    SENSOR_STALE = "sensor_stale"
    """No scan, cloud or map came for `safety.scan_timeout`."""
    POSE_STALE = "pose_stale"
    """No pose came for `safety.pose_timeout`."""
    MAP_STALE = "map_stale"
    """The belief took nothing in for `safety.scan_timeout` although messages came."""
    POSE_JUMP = "pose_jump"
    """The pose moved faster than the robot can."""
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


class HealthMonitor:
    """Hear of everything that must stay fresh and true, and say what is wrong.

    All times are seconds of one monotonic clock and given by the caller; nothing here waits or reads a clock. Every
    method is safe to call from the threads of subscriptions.

    Usage::

        monitor.heard_sensor(now)  # in the subscription
        monitor.heard_pose(now, stamp, pose)
        monitor.updated_map(now)  # when the belief took something in
        for fault in monitor.check(now, waypoint=waypoint, is_free=is_free):
            gate.hold(fault.reason)
    """

    def __init__(self, config: SafetyConfig, fence: Geofence | None = None, sensor: str = "scan") -> None:
        """Watch with the timeouts of `config`.

        Args:
            config: timeouts, speed limit and permitted jump.
            fence: where the robot may be; made from the configuration when not given.
            sensor: name of the sensor for the operator: scan, points or grid.
        """
        self._config = config
        self._fence = Geofence(config.geofence) if fence is None else fence
        self._sensor = sensor
        self.reset()

    def reset(self) -> None:
        """Forget everything that was heard, as when the robot's software starts anew."""
        self._sensor_time: float | None = None
        self._map_time: float | None = None
        self._pose: tuple[float, float, Pose] | None = None
        self._jump: tuple[float, str] | None = None
        self._policy_error: str | None = None

    def heard_sensor(self, now: float) -> None:
        """A scan, cloud or map arrived."""
        self._sensor_time = now

    def updated_map(self, now: float) -> None:
        """The belief took in what had arrived."""
        self._map_time = now

    def heard_pose(self, now: float, stamp: float, pose: Pose) -> None:
        """A pose arrived.

        Args:
            now: time of arrival.
            stamp: the message's own time, robot clock, seconds; speeds are measured with it.
            pose: in the map frame.
        """
        if not (isfinite(pose.x) and isfinite(pose.y) and isfinite(pose.yaw)):
            self._jump = now, f"the pose is not finite: {pose}"
            return
        if self._pose is not None:
            _, last_stamp, last = self._pose
            # A clock set back tells nothing about speed: then only the permitted jump counts.
            elapsed = max(stamp - last_stamp, 0.0)
            moved = hypot(pose.x - last.x, pose.y - last.y)
            if moved > self._config.pose_jump + self._config.speed_limit * elapsed:
                self._jump = now, f"the pose jumped {moved:.2f} m in {elapsed:.2f} s"
        self._pose = now, stamp, pose

    def policy_failed(self, error: BaseException) -> None:
        """The planner raised an error; the fault stays until it decides again."""
        self._policy_error = f"{type(error).__name__}: {error}"

    def policy_decided(self) -> None:
        """The planner made a decision."""
        self._policy_error = None

    def check(
        self, now: float, *, waypoint: Point | None = None, is_free: Callable[[Point], bool] | None = None
    ) -> list[Fault]:
        """Say all that is wrong now.

        Args:
            now: seconds.
            waypoint: where the robot is sent, (x, y) in metres.
            is_free: whether a position is known to be free in the belief.
        """
        faults: list[Fault] = []
        config = self._config
        for kind, what, last, timeout in (
            (FaultKind.SENSOR_STALE, f"no {self._sensor}", self._sensor_time, config.scan_timeout),
            (FaultKind.POSE_STALE, "no pose", self._pose[0] if self._pose else None, config.pose_timeout),
            (FaultKind.MAP_STALE, "no new map data", self._map_time, config.scan_timeout),
        ):
            if last is None:
                faults.append(Fault(kind, f"{what} has come yet"))
            elif now - last > timeout:
                faults.append(Fault(kind, f"{what} for {now - last:.1f} s (limit {timeout:g} s)"))
        # The planner starts over from the new place, so a jump is over once poses have been steady for a while.
        if self._jump is not None and now - self._jump[0] <= config.pose_timeout:
            faults.append(Fault(FaultKind.POSE_JUMP, self._jump[1]))
        if self._policy_error is not None:
            faults.append(Fault(FaultKind.POLICY_ERROR, f"the planner failed: {self._policy_error}"))
        if self._pose is not None and not self._fence.contains(self._pose[2].position):
            faults.append(Fault(FaultKind.GEOFENCE, f"the robot is outside the geofence at {_text(self._pose[2])}"))
        if waypoint is not None:
            if not self._fence.contains(waypoint):
                faults.append(Fault(FaultKind.GEOFENCE, f"the waypoint {waypoint} is outside the geofence"))
            if is_free is not None and not is_free(waypoint):
                faults.append(Fault(FaultKind.WAYPOINT_OCCUPIED, f"the waypoint {waypoint} is no longer free"))
        return faults


def _text(pose: Pose) -> str:
    return f"({pose.x:.2f}, {pose.y:.2f})"

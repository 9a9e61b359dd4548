"""Faults of the bridge's inputs and decisions that must stop the robot."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from common.geometry import Pose
from deploy.config import Point, SafetyConfig
from deploy.safety.awaited import Awaited
from deploy.safety.faults import Fault as Fault  # noqa: PLC0414  (exported from here too)
from deploy.safety.faults import FaultKind as FaultKind  # noqa: PLC0414
from deploy.safety.geofence import Geofence
from deploy.safety.motion import MotionWatch
from deploy.safety.sensor_watch import SensorWatch
from deploy.tf.leaps import leap
from deploy.tf.stamps import Order, StampOrder
from deploy.tf.swings import PoseSwings


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

    def __init__(
        self,
        config: SafetyConfig,
        fence: Geofence | None = None,
        sensor: str = "scan",
        awaited: Awaited = Awaited(),  # noqa: B008  (immutable)
    ) -> None:
        """Watch with the timeouts of `config`.

        Args:
            config: timeouts, speed limit and permitted jump.
            fence: where the robot may be; that of its centre alone when not given.
            sensor: name of the sensor for the operator: scan, points or grid.
            awaited: where sensor and pose are waited for.
        """
        self._config = config
        self._fence = Geofence(config.geofence) if fence is None else fence
        self._sensor = sensor
        self._awaited = awaited
        # A map comes when it changes, perhaps only once; that it is still true, the poses have to tell.
        self._latched = sensor == "grid"
        self.reset()

    def reset(self) -> None:
        """Forget everything that was heard, as when the robot's software starts anew."""
        self._sensors = SensorWatch(self._sensor, self._config.scan_timeout, awaited=self._awaited.sensor)
        self._others: dict[str, SensorWatch] = {}
        self._pose_arrived: float | None = None
        self._pose_refused: tuple[float, str] | None = None
        self._pose_order = StampOrder()
        self._clock: tuple[float, str] | None = None
        self._motion = MotionWatch()
        self._swings = PoseSwings("odometry or the transform of the base")
        self._map_time: float | None = None
        self._pose: tuple[float, float, Pose] | None = None
        self._jump: tuple[float, str] | None = None
        self._policy_error: str | None = None

    def heard_sensor(self, now: float, stamp: float | None = None, fault: Fault | None = None, frame: str = "") -> None:
        """A scan, cloud or map arrived.

        Args:
            now: time of arrival.
            stamp: the message's own time, robot clock, seconds, which has to advance; not given for maps, which may
                be published again as they are.
            fault: what is wrong with the message itself, as `Sight` says; None when it is sound.
            frame: of its header, by which several lidars on one topic are told apart.
        """
        order = self._sensors.order(now, frame)
        news = stamp is None or self._advances(order, stamp, now)
        self._sensors.take(now, frame, fault, news=news)

    def heard_other(self, name: str, now: float, stamp: float, fault: Fault | None = None, frame: str = "") -> None:
        """A message of another sensor arrived, by which the robot avoids obstacles; it must not fall silent then.

        Args:
            name: of the sensor for the operator: scan or points.
            now: as for `heard_sensor`, and so are the others.
            stamp: likewise.
            fault: likewise.
            frame: likewise.
        """
        watch = self._others.setdefault(name, SensorWatch(name, self._config.scan_timeout, required=False))
        news = self._advances(watch.order(now, frame), stamp, now)
        watch.take(now, frame, fault, news=news)

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
        self._pose_arrived = now
        if self._pose is not None:
            _, last_stamp, last = self._pose
            # A clock set back tells nothing about speed: then only the permitted jump counts.
            elapsed = max(stamp - last_stamp, 0.0)
            leapt = leap(last, pose, elapsed, self._config.pose_jump, self._config.speed_limit)
            if leapt:
                self._jump = now, leapt
        swings = self._swings.take(stamp, pose)
        if swings:
            self.disagreed(now, swings)
        if self._advances(self._pose_order, stamp, now):
            self._pose = now, stamp, pose
            self._motion.heard_pose(now, stamp, pose)

    def refused_pose(self, now: float, reason: str) -> None:
        """A pose arrived that does not count, which an operator has to know where no other one comes."""
        self._pose_refused = now, reason

    def disagreed(self, now: float, reason: str) -> None:
        """Two sources of the pose contradict each other, so that none tells where the robot is."""
        self._jump = now, reason

    def commanded(self, now: float, linear: float, angular: float) -> None:
        """A velocity was let through to the wheels, m/s and rad/s; the pose has to show it."""
        self._motion.commanded(now, linear, angular)

    def measured(self, now: float, linear: float, angular: float) -> None:
        """The odometry reports a velocity, m/s and rad/s; the pose has to show it."""
        self._motion.measured(now, linear, angular)

    def try_again(self) -> None:
        """An operator wants the robot to move: a pose that stood still is no fault until it does so again."""
        self._motion.forgive()

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
        sensor = None if self._latched and self._sensors.heard else self._sensors.fault(now)
        others = [watch.fault(now) for watch in tuple(self._others.values())]
        faults = [*(fault for fault in (sensor, *others) if fault is not None), *self._pose_faults(now)]
        config = self._config
        last = self._map_time
        if last is None:
            faults.append(Fault(FaultKind.MAP_STALE, "no map data received yet"))
        elif now - last > config.scan_timeout and not self._latched:
            faults.append(_stale(FaultKind.MAP_STALE, "no new map data", now - last, config.scan_timeout))
        if self._clock is not None and now - self._clock[0] <= config.pose_timeout:
            faults.append(Fault(FaultKind.CLOCK_SET_BACK, self._clock[1]))
        # The planner starts over from the new place, so a jump is over once poses have been steady for a while.
        if self._jump is not None and now - self._jump[0] <= config.pose_timeout:
            faults.append(Fault(FaultKind.POSE_JUMP, self._jump[1]))
        if self._policy_error is not None:
            faults.append(Fault(FaultKind.POLICY_ERROR, f"the planner failed: {self._policy_error}"))
        if self._pose is not None and not self._fence.holds(self._pose[2]):
            faults.append(Fault(FaultKind.GEOFENCE, f"the robot is outside the geofence at {_text(self._pose[2])}"))
        if waypoint is not None:
            if not self._fence.contains(waypoint):
                faults.append(Fault(FaultKind.GEOFENCE, f"the waypoint {waypoint} is outside the geofence"))
            if is_free is not None and not is_free(waypoint):
                faults.append(Fault(FaultKind.WAYPOINT_OCCUPIED, f"the waypoint {waypoint} is no longer free"))
        return faults

    def _advances(self, order: StampOrder, stamp: float, now: float) -> bool:
        """Whether a stamp is news; notes a clock that was set back."""
        newest = order.newest
        found = order.take(stamp)
        if found is Order.SET_BACK and newest is not None:
            self._swings.forget()
            self._clock = (
                now,
                f"the robot's clock was set back by {newest - stamp:.2f} s or more: earlier data is discarded",
            )
        return found in {Order.AHEAD, Order.SET_BACK}

    def _pose_faults(self, now: float) -> list[Fault]:
        timeout, refused = self._config.pose_timeout, self._pose_refused
        why = "" if refused is None or now - refused[0] > timeout else f"those that arrive do not count: {refused[1]}"
        if self._pose is None:
            what = f"; {why}" if why else self._awaited.pose
            return [Fault(FaultKind.POSE_STALE, f"no pose received yet{what}")]
        last, arrived = self._pose[0], self._pose_arrived
        if arrived is None or now - arrived > timeout:
            stale = _stale(FaultKind.POSE_STALE, "no pose", now - last, timeout)
            return [Fault(stale.kind, f"{stale.reason}; {why}") if why else stale]
        if now - last > timeout:
            stamp = self._pose_order.newest
            return [
                Fault(
                    FaultKind.POSE_FROZEN,
                    f"poses arrive, but their stamp has not advanced beyond {stamp} s for {timeout:g} s",
                )
            ]
        stands = self._motion.fault(now)
        return [Fault(FaultKind.POSE_FROZEN, stands)] if stands else []


def _stale(kind: FaultKind, what: str, seconds: float, limit: float) -> Fault:
    return Fault(kind, f"{what} for {seconds:.1f} s (limit {limit:g} s)")


def _text(pose: Pose) -> str:
    return f"({pose.x:.2f}, {pose.y:.2f})"

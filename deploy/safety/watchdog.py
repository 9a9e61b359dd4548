"""The watchdog process: it owns the velocity topic and outlives the bridge.

It is started by `VelocityGate`, has a Zenoh session of its own, and trusts nothing of the bridge but its wishes.
"""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import socket
import struct
import sys
import time
import uuid
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final

from common.closing import Closing
from common.errors import HDError
from common.logs import setup_logging
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, SENSOR, Message, Node, Received, message
from deploy.safety.channel import Channel
from deploy.safety.gate_state import GateMode, GateState
from deploy.safety.output import VelocityOutput
from deploy.safety.rules import Decision, GateRules

log = logging.getLogger("deploy.safety.watchdog")  # also when run as __main__

_REPORT_PERIOD: Final = 0.2
_STATUS_PERIOD: Final = 1.0
# A Header's stamp stands first in CDR: 4 bytes of encapsulation, then int32 seconds and uint32 nanoseconds.
_STAMP: Final = {0: struct.Struct(">4xiI"), 1: struct.Struct("<4xiI")}


class Watchdog(Closing):
    """One watchdog: inputs from the bus and from the bridge, velocities out.

    The callbacks of the bus only note what came and wake the loop.
    """

    def __init__(self, config: DeployConfig, channel: Channel, emergency_stop: str = "") -> None:
        """Join the bus and stop the robot.

        Raises:
            RosError: the bus cannot be joined, or a topic's name is malformed.
        """
        self._config = config
        self._channel = channel
        self._id = uuid.uuid4().hex
        self._rules = GateRules(config, time.monotonic(), emergency_stop)
        self._wakeup, self._waker = os.pipe()
        os.set_blocking(self._waker, False)
        os.set_blocking(self._wakeup, False)
        self._connected = True
        self._other: tuple[float, str] | None = None
        self._clock_offset: float | None = None
        self._last: Decision | None = None
        self._forwarded: float | None = None
        self._new_wish = False
        self._sent = (0.0, 0.0)
        self._stop_sent: int | None = None
        self._next_velocity = self._next_report = self._next_status = 0.0
        self._node = Node(config.ros, f"{config.ros.node}_watchdog", config.topics.remap)
        try:
            self._output = VelocityOutput(self._node, config)
            self._output.velocity(0.0, 0.0)
            self._status = self._node.publisher(config.topics.watchdog, "std_msgs/msg/String", LATCHED)
            self._subscribe()
        except BaseException:
            self.close()
            raise

    def run(self) -> None:
        """Watch until the bridge ends in order, or has been dead for `safety.zero_for`."""
        self.tell_to_end_on(signal.SIGTERM)
        while True:
            now = time.monotonic()
            self._hear_bridge(now)
            decision = self._rules.decide(now)
            self._act(decision, now)
            if decision.ended or self._succeeded():
                log.info("the watchdog ends: %s", decision.reason if decision.ended else "another one has taken over")
                return
            self._wait(min(self._next_velocity, self._next_report, self._next_status) - time.monotonic())

    def tell_to_end_on(self, number: signal.Signals) -> None:
        """Take a signal for the bridge's death: the service is being stopped."""

        def handle(*_: object) -> None:
            self._rules.bridge_died(time.monotonic(), f"the watchdog was told to end by {number.name}")
            self._wake()

        signal.signal(number, handle)

    def close(self) -> None:
        """Leave the bus."""
        self._node.close()
        for end in (self._wakeup, self._waker):
            with suppress(OSError):
                os.close(end)
        self._wakeup = self._waker = -1

    # Inputs

    def _subscribe(self) -> None:
        config, node, topics = self._config, self._node, self._config.topics
        # What stops comes first: nothing moves before sensors are heard, and declarations travel in their order.
        if topics.emergency_stop:
            node.subscribe(topics.emergency_stop, "std_msgs/msg/Bool", self._heard_emergency_stop)
        if topics.joy:
            node.subscribe(topics.joy, "sensor_msgs/msg/Joy", self._heard_joystick)
        node.subscribe(topics.watchdog, "std_msgs/msg/String", self._heard_watchdog)
        topic, kind, qos = {
            "scan": (topics.scan, "sensor_msgs/msg/LaserScan", SENSOR),
            "points": (topics.points, "sensor_msgs/msg/PointCloud2", SENSOR),
            "grid": (topics.map, "nav_msgs/msg/OccupancyGrid", LATCHED),
        }[config.sensing.source]
        node.subscribe_raw(topic, kind, self._heard_sensor, qos)
        if config.sensing.pose == "odometry":
            node.subscribe_raw(topics.odometry, "nav_msgs/msg/Odometry", self._heard_pose, SENSOR)
        else:
            node.subscribe(topics.tf, "tf2_msgs/msg/TFMessage", self._heard_transforms)

    def _heard_sensor(self, payload: bytes, received: Received) -> None:
        self._rules.sensor_time = received.time
        self._note_clock(payload, received)
        self._wake_unless_clear()

    def _heard_pose(self, payload: bytes, received: Received) -> None:
        self._rules.pose_time = received.time
        self._note_clock(payload, received)
        self._wake_unless_clear()

    def _heard_transforms(self, transforms: Message, received: Received) -> None:
        # SLAM's own transform must not hide that the robot's odometry has stopped.
        if any(one.child_frame_id.lstrip("/") == self._config.frames.base for one in transforms.transforms):
            self._rules.pose_time = received.time
            self._wake_unless_clear()

    def _heard_emergency_stop(self, stop: Message, received: Received) -> None:
        if stop.data:
            log.debug("emergency stop heard %.3f s ago", time.monotonic() - received.time)
            self._rules.latch(self._config.topics.emergency_stop)
            self._wake()

    def _heard_joystick(self, joy: Message, received: Received) -> None:
        self._rules.joystick([float(axis) for axis in joy.axes], received.time)
        self._wake()

    def _heard_watchdog(self, status: Message, received: Received) -> None:
        try:
            other, mode = (json.loads(status.data)[key] for key in ("watchdog", "mode"))
        except (ValueError, TypeError, KeyError):
            return
        # One that only waits for its end gives way by itself.
        if other == self._id or mode == GateMode.BRIDGE_GONE:
            return
        if self._rules.bridge_gone:
            self._wake()
        elif self._other is None or self._other[1] != other:
            log.warning("another watchdog sends velocities as well: is a second bridge running for this robot?")
        self._other = received.time, other

    def _succeeded(self) -> bool:
        """Whether a new bridge's watchdog came after this one's bridge had died."""
        gone = self._rules.gone_since
        return gone is not None and self._other is not None and self._other[0] > gone

    def _note_clock(self, payload: bytes, received: Received) -> None:
        if len(payload) >= 12 and payload[1] in _STAMP:
            seconds, nanoseconds = _STAMP[payload[1]].unpack_from(payload)
            self._clock_offset = seconds + nanoseconds * 1e-9 - received.time

    def _hear_bridge(self, now: float) -> None:
        if not self._connected:
            return
        try:
            packets = self._channel.receive()
        except EOFError:
            self._connected = False
            self._rules.bridge_died(now, "the bridge's process is dead")
            return
        for packet in packets:
            # Both processes read the same monotonic clock, so a packet that waited here is no younger for it.
            self._rules.bridge_lives(packet["sent"])
            self._take(packet, now)

    def _take(self, packet: dict[str, Any], now: float) -> None:
        match packet["kind"]:
            case "wish":
                self._rules.wish(packet["sent"], packet["linear"], packet["angular"])
                self._new_wish = True
            case "hold":
                self._rules.hold(packet["reason"])
            case "resume":
                self._rules.resume()
            case "emergency_stop":
                self._rules.latch(packet["reason"])
            case "release":
                self._rules.release()
            case "finish":
                self._rules.finish(now)

    # Outputs

    def _act(self, decision: Decision, now: float) -> None:
        changed = self._last is None or (decision.mode, decision.reason) != (self._last.mode, self._last.reason)
        if changed:
            self._log_change(decision)
        self._last = decision
        due = now >= self._next_velocity
        forward = self._new_wish and decision.mode is GateMode.CLEAR
        if changed or due or forward:
            self._next_velocity = now + 1.0 / self._config.driving.rate
            self._new_wish = False
            if decision.velocity is not None:
                self._sent = decision.velocity
                self._output.velocity(*decision.velocity, self._robot_time(now))
            if decision.stop or decision.stop != self._stop_sent:
                self._output.stop(decision.stop)
                self._stop_sent = decision.stop
        if changed or now >= self._next_report:
            self._next_report = now + _REPORT_PERIOD
            self._channel.send(**asdict(self._state(decision, now)))
        if changed or now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            status = {"watchdog": self._id, **asdict(self._state(decision, now))}
            self._status.publish(message("std_msgs/msg/String", self._config.ros.distro, data=json.dumps(status)))

    def _state(self, decision: Decision, now: float) -> GateState:
        rules = self._rules
        return GateState(
            mode=decision.mode,
            reason=decision.reason,
            emergency_stop=bool(rules.emergency_stop),
            overridden=rules.overridden(now),
            sensor_age=None if rules.sensor_time is None else round(now - rules.sensor_time, 3),
            pose_age=None if rules.pose_time is None else round(now - rules.pose_time, 3),
            linear=self._sent[0],
            angular=self._sent[1],
            clipped=decision.clipped,
        )

    def _log_change(self, decision: Decision) -> None:
        level = logging.INFO if decision.mode in {GateMode.CLEAR, GateMode.HELD} else logging.WARNING
        before = "start" if self._last is None else self._last.mode.value
        log.log(level, "%s -> %s: %s", before, decision.mode.value, decision.reason)

    def _robot_time(self, now: float) -> float:
        time = 0.0 if self._clock_offset is None else now + self._clock_offset
        return time if 0.0 <= time < 2**31 - 1 else 0.0

    # Waiting

    def _wait(self, seconds: float) -> None:
        ends: list[Any] = [self._wakeup]
        if self._connected:
            ends.append(self._channel)
        ready, _, _ = select.select(ends, [], [], max(0.0, seconds))
        if self._wakeup in ready:
            with suppress(BlockingIOError):
                os.read(self._wakeup, 4096)

    def _wake(self) -> None:
        # A full pipe wakes as well, and after `close` nobody sleeps.
        with suppress(OSError):
            os.write(self._waker, b".")

    def _wake_unless_clear(self) -> None:
        if self._last is not None and self._last.mode in {GateMode.SENSOR_STALE, GateMode.POSE_STALE}:
            self._wake()


def main() -> int:
    """Run the watchdog at the end of a channel whose file descriptor is the first argument."""
    # Ctrl-C in a terminal ends the bridge, and through it the watchdog.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with Channel(socket.socket(fileno=int(sys.argv[1]))) as channel:
        select.select([channel], [], [])
        try:
            start = channel.receive()[0]
        except EOFError:
            return 0
        setup_logging(start["log_level"])
        try:
            config = DeployConfig.model_validate_json(start["config"])
            with Watchdog(config, channel, start["emergency_stop"]) as watchdog:
                watchdog.run()
        except HDError as error:
            log.error("%s", error)
            channel.send(failed=str(error))
            return 1
    return 0


if __name__ == "__main__":
    # Threads of a library must not keep a watchdog alive that has nothing left to watch.
    status = main()
    logging.shutdown()
    os._exit(status)

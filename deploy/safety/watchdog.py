"""The watchdog process: it owns the velocity topic and outlives the bridge.

It is started by `VelocityGate`, has a Zenoh session of its own, and trusts nothing of the bridge but its commands.
"""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import socket
import sys
import time
import uuid
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final

from common.errors import HDError
from common.system.closing import Closing
from common.system.logs import setup_logging
from common.system.signals import ignore_signals, on_signals
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, Node, message
from deploy.safety.awaited import awaited
from deploy.safety.channel import Channel
from deploy.safety.gate_state import GateMode, GateState
from deploy.safety.inputs import WatchdogInputs
from deploy.safety.output import VelocityOutput
from deploy.safety.rules import Decision, GateRules

log = logging.getLogger("deploy.safety.watchdog")  # also when run as __main__

_REPORT_PERIOD: Final = 0.2
_STATUS_PERIOD: Final = 1.0


class Watchdog(Closing):
    """One watchdog: inputs from the bus and from the bridge, velocities out.

    One loop decides; the callbacks of the bus only note what came and wake it.
    """

    def __init__(self, config: DeployConfig, channel: Channel, emergency_stop: str = "") -> None:
        """Join the bus and stop the robot.

        Raises:
            RosError: the bus cannot be joined, or a topic's name is malformed.
        """
        self._config = config
        self._channel = channel
        self._id = uuid.uuid4().hex
        self._rules = GateRules(
            config.safety,
            config.sensing.source,
            time.monotonic(),
            emergency_stop,
            drives=config.driving.enabled,
            awaited=awaited(config),
        )
        self._wakeup, self._waker = os.pipe()
        os.set_blocking(self._waker, False)
        os.set_blocking(self._wakeup, False)
        self._connected = True
        self._last: Decision | None = None
        self._new_command = False
        self._sent = (0.0, 0.0)
        self._stop_sent: int | None = None
        self._next_velocity = self._next_report = self._next_status = 0.0
        self._inputs = WatchdogInputs(config, self._rules, self._id, self._wake, self._wake_unless_clear)
        self._node = Node(config.ros, f"{config.ros.node}_watchdog", config.topics.remap)
        try:
            self._output = VelocityOutput(self._node, config.topics, config.driving.message, config.frames.base)
            self._output.velocity(0.0, 0.0)
            self._status = self._node.publisher(config.topics.watchdog, "std_msgs/msg/String", LATCHED)
            self._inputs.subscribe(self._node)
        except BaseException:
            self.close()
            raise

    def run(self) -> None:
        """Watch until the bridge ends in order, or has been dead for `safety.zero_for`."""
        with on_signals(self._told_to_end, signal.SIGTERM):
            self._run()

    def _run(self) -> None:
        while True:
            now = time.monotonic()
            self._hear_bridge(now)
            decision = self._rules.decide(now)
            self._act(decision, now)
            gone = self._rules.gone_since
            # A new bridge's watchdog came after this one's bridge had died.
            replaced = gone is not None and self._inputs.another_since(gone)
            if decision.ended or replaced:
                log.info("the watchdog ends: %s", decision.reason if decision.ended else "another one has taken over")
                return
            self._wait(min(self._next_velocity, self._next_report, self._next_status) - time.monotonic())

    def _told_to_end(self, number: signal.Signals) -> None:
        """Take a signal for the bridge's death: the service is being stopped."""
        self._rules.bridge_died(time.monotonic(), f"the watchdog was asked to end by {number.name}")
        self._wake()

    def close(self) -> None:
        """Leave the bus."""
        self._node.close()
        for end in (self._wakeup, self._waker):
            with suppress(OSError):
                os.close(end)
        self._wakeup = self._waker = -1

    # The bridge

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
            case "command":
                self._rules.command(packet["sent"], packet["linear"], packet["angular"])
                self._new_command = True
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
        forward = self._new_command and decision.mode is GateMode.CLEAR
        if changed or due or forward:
            self._next_velocity = now + 1.0 / self._config.driving.rate
            self._new_command = False
            if decision.velocity is not None:
                self._sent = decision.velocity
                self._output.velocity(*decision.velocity, self._inputs.robot_time(now))
            if decision.stop or decision.stop != self._stop_sent:
                self._output.stop(decision.stop)
                self._stop_sent = decision.stop
        if changed or now >= self._next_report:
            self._next_report = now + _REPORT_PERIOD
            self._channel.send(**asdict(self._state(decision, now)))
        if changed or now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD
            state = asdict(self._state(decision, now))
            status = {"watchdog": self._id, **state, "robot": self._inputs.robot}
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
            heard=self._output.heard,
        )

    def _log_change(self, decision: Decision) -> None:
        level = logging.INFO if decision.mode in {GateMode.CLEAR, GateMode.HELD} else logging.WARNING
        before = "start" if self._last is None else self._last.mode.value
        log.log(level, "%s -> %s: %s", before, decision.mode.value, decision.reason)

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
    ignore_signals(signal.SIGINT, signal.SIGHUP)
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

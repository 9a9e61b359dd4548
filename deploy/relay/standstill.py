"""Stops the robot when the watchdog's word no longer comes through: the relay is the last hop to the wheels."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

from common.system.documents import parse_json
from deploy.config import SafetyConfig
from deploy.ros2.conversions import velocity_from
from deploy.ros2.errors import RosError
from deploy.ros2.messages import deserialize, message, serialize
from deploy.safety.gate_state import GateMode
from deploy.safety.rules import GO, STOP_ALL

log = logging.getLogger(__name__)

WATCHDOG_SILENT: Final = 2.5
"""The watchdog tells its state every second; after so many without a word it counts as out of reach."""
_PERIOD: Final = 0.1


class Standstill:
    """Notes what the watchdog sends, and sends zeros and `/stop` in its place when it falls silent under way.

    Under way means that the last velocity was not zero, or, where the robot's own stack drives, that the watchdog's
    last word was that it lets the robot drive. One that ends in order says before that it stops the robot.
    """

    def __init__(
        self,
        safety: SafetyConfig,
        kind: str,
        distro: str,
        velocity: Callable[[bytes], None] | None,
        stop: Callable[[bytes], None] | None,
    ) -> None:
        """Watch over a robot.

        Args:
            safety: times of silence.
            kind: type of velocities, ``Twist`` or ``TwistStamped``.
            distro: the robot's ROS distribution.
            velocity: publishes on the velocity topic in DDS; None where there is none.
            stop: publishes on the stop topic in DDS; None where there is none.
        """
        self._safety = safety
        self._distro = distro
        self._kind = f"geometry_msgs/msg/{kind}"
        self._velocity = velocity
        self._stop = stop
        self._lock = threading.Lock()
        self._zero = serialize(message(self._kind, distro), self._kind, distro)
        self._levels = {
            level: serialize(message("std_msgs/msg/Int8", distro, data=level), "std_msgs/msg/Int8", distro)
            for level in (GO, STOP_ALL)
        }
        self._last_stop = self._levels[GO]
        self._moving = self._clear = False
        self._heard_velocity = self._heard_watchdog = 0.0
        self._lost_watchdog = False
        self._began: float | None = None
        self._next = 0.0

    @property
    def stopping(self) -> bool:
        """Whether the relay stops the robot at this moment."""
        return self._began is not None

    def heard_velocity(self, payload: bytes, now: float) -> None:
        """Note a velocity of the watchdog that has just gone to the robot."""
        try:
            moving = velocity_from(deserialize(payload, self._kind, self._distro)) != (0.0, 0.0)
        except RosError:
            # What cannot be read may move it.
            moving = True
        with self._lock:
            self._moving, self._heard_velocity = moving, now
            if not self._lost_watchdog:
                self._began = None

    def heard_stop(self, payload: bytes) -> None:
        """Note a stop level of the watchdog that has just gone to the robot."""
        self._last_stop = payload

    def heard_watchdog(self, payload: bytes, now: float) -> None:
        """Note what the watchdog tells about itself."""
        try:
            mode = parse_json(deserialize(payload, "std_msgs/msg/String", self._distro).data)["mode"]
        except (RosError, ValueError, KeyError, TypeError):
            return
        with self._lock:
            self._clear, self._heard_watchdog = mode == GateMode.CLEAR, now
            back, self._lost_watchdog = self._lost_watchdog, False
            if back:
                self._began = None
        if back:
            log.warning("the watchdog reports again")
            if self._stop is not None:
                self._stop(self._last_stop)

    def tick(self, now: float) -> None:
        """Stop the robot if it has to be; to be called every few hundredths of a second."""
        with self._lock:
            self._look(now)
            # As long as the watchdog itself does when its bridge has died.
            if self._began is None or now - self._began > self._safety.zero_for or now < self._next:
                return
            self._next = now + _PERIOD
            self._moving = False
        self.stop_now()

    def stop_now(self) -> None:
        """Send a zero velocity and the stop level once."""
        if self._velocity is not None:
            self._velocity(self._zero)
        if self._stop is not None:
            self._stop(self._levels[STOP_ALL])

    def leave(self) -> None:
        """Stop a robot that is under way, because the relay ends."""
        if self._moving or self._clear:
            self.stop_now()

    def _look(self, now: float) -> None:
        """Begin to stop the robot where it has to be; the lock is held."""
        limit = self._safety.bridge_timeout
        if self._clear and not self._lost_watchdog and now - self._heard_watchdog > WATCHDOG_SILENT:
            self._lost_watchdog = True
            self._begin(now, f"no report from the watchdog for {WATCHDOG_SILENT:g} s")
        elif self._moving and self._began is None and now - self._heard_velocity > limit:
            self._begin(now, f"no velocity for {limit:g} s after one that moves the robot")

    def _begin(self, now: float, why: str) -> None:
        self._began = now
        log.error("%s: the relay stops the robot", why)

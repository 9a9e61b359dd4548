"""When an operator's joystick takes over."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from deploy.config import SafetyConfig


class Takeover:
    """Take over while the sticks are moved, and for `safety.joy_release` after they came to rest.

    Sticks at rest are known only from a message that says so: a joystick that falls silent while they are moved,
    held steady or out of battery, keeps what it has.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._axes = config.joy_axes
        self._deadband = config.joy_deadband
        self._release = config.joy_release
        self._moved = False
        self._rested: float | None = None

    def heard(self, axes: Sequence[float], now: float) -> None:
        """Take in a sensor_msgs/Joy's axes, each from -1 to 1."""
        # A joystick that has none of the axes that were chosen is another one than was meant: then any axis counts.
        chosen = [axes[axis] for axis in self._axes if axis < len(axes)] or axes
        moved = any(not isfinite(axis) or abs(axis) > self._deadband for axis in chosen)
        if self._moved and not moved:
            self._rested = now
        self._moved = moved

    def active(self, now: float) -> bool:
        """Whether the operator has the robot."""
        return self._moved or (self._rested is not None and now - self._rested < self._release)

"""Twist messages to velocities, and back."""

from __future__ import annotations

import math

from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message


def velocity_from(command: Message) -> tuple[float, float]:
    """Return (forwards m/s, turning rad/s) of a Twist or TwistStamped.

    Raises:
        RosError: when they are not finite.
    """
    inner: Message = getattr(command, "twist", command)
    linear, angular = inner.linear.x, inner.angular.z
    if not (math.isfinite(linear) and math.isfinite(angular)):
        raise RosError(f"a velocity must be finite, got ({linear}, {angular})")
    return linear, angular


def twist(linear: float, angular: float) -> Message:
    """Build a Twist: forwards m/s, turning rad/s."""
    return message(
        "geometry_msgs/msg/Twist",
        linear=message("geometry_msgs/msg/Vector3", x=linear),
        angular=message("geometry_msgs/msg/Vector3", z=angular),
    )


def twist_stamped(time: float, frame: str, linear: float, angular: float) -> Message:
    """Build a TwistStamped: forwards m/s, turning rad/s."""
    return message("geometry_msgs/msg/TwistStamped", header=header(time, frame), twist=twist(linear, angular))

"""The topics that move and stop the robot."""

from __future__ import annotations

from deploy.network_config import TopicsConfig
from deploy.ros2 import Node, Publisher, message
from deploy.ros2.conversions import twist, twist_stamped


class VelocityOutput:
    """Publishes velocities in the robot's type, and `/stop` where the robot has it.

    Only the watchdog uses it; the bridge does for the moment in which there is no watchdog.
    """

    def __init__(self, node: Node, topics: TopicsConfig, kind: str, frame: str) -> None:
        """Declare the publishers.

        Args:
            node: of the watchdog.
            topics: names of those for velocities and stops; an empty one has no publisher.
            kind: type of velocities, ``Twist`` or ``TwistStamped``.
            frame: of the robot's base.

        Raises:
            RosError: a topic's name is malformed.
        """
        self._kind = f"geometry_msgs/msg/{kind}"
        self._distro = node.distro
        self._frame = frame
        self._velocity: Publisher | None = node.publisher(topics.velocity, self._kind) if topics.velocity else None
        self._stop: Publisher | None = node.publisher(topics.stop, "std_msgs/msg/Int8") if topics.stop else None

    @property
    def heard(self) -> bool:
        """Whether anybody listens to the velocities, with the same type; true where there is no such topic."""
        return self._velocity is None or self._velocity.heard

    def velocity(self, linear: float, angular: float, time: float = 0.0) -> None:
        """Publish a velocity.

        Args:
            linear: m/s.
            angular: rad/s.
            time: robot time for TwistStamped, seconds; 0 is what receivers take for now.
        """
        if self._velocity is None:
            return
        stamped = self._kind.endswith("Stamped")
        self._velocity.publish(twist_stamped(time, self._frame, linear, angular) if stamped else twist(linear, angular))

    def stop(self, level: int) -> None:
        """Publish the CMU stack's stop level: 0 go, 1 zero linear, 2 also zero yaw."""
        if self._stop is not None:
            self._stop.publish(message("std_msgs/msg/Int8", self._distro, data=level))

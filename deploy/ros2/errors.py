"""What can go wrong between the bridge and ROS 2."""

from common.errors import HDError


class RosError(HDError):
    """A topic, a type, a QoS or a message cannot be used; the text says what was expected and what came."""

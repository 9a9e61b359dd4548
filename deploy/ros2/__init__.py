"""ROS 2 over Zenoh without ROS: nodes, publishers, subscriptions, messages."""

from deploy.ros2.endpoints import Latest, Publisher, Received, Subscription
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message, seconds, stamp
from deploy.ros2.node import Node
from deploy.ros2.qos import LATCHED, RELIABLE, SENSOR, STATIC, QoS

__all__ = [
    "LATCHED",
    "RELIABLE",
    "SENSOR",
    "STATIC",
    "Latest",
    "Message",
    "Node",
    "Publisher",
    "QoS",
    "Received",
    "RosError",
    "Subscription",
    "header",
    "message",
    "seconds",
    "stamp",
]

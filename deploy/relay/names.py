"""Under which names a relay is known on the bridge's network."""

from __future__ import annotations

from deploy.network_config import RosConfig
from deploy.ros2.names import namespace


def relay_name(robot: str) -> str:
    """Return the name under which the relay of a robot answers on the bus."""
    return f"{robot[:58]}-relay"


def node_name(ros: RosConfig) -> str:
    """Return the name of a relay's node in Zenoh, without its namespace."""
    return f"{ros.node}_relay"


def node_of_relay(ros: RosConfig) -> str:
    """Return the full name of a relay's node in Zenoh."""
    return f"{namespace(ros.namespace).rstrip('/')}/{node_name(ros)}"

"""A real Zenoh router as ROS 2 sets one up, and nodes around it."""

import contextlib
import json

import zenoh

from deploy.network_config import RosConfig
from tests.common.bus.processes import free_port

KINDS = (
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/Joy",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/msg/Bool",
    "std_msgs/msg/Float32",
    "std_msgs/msg/Int8",
    "std_msgs/msg/String",
    "tf2_msgs/msg/TFMessage",
    "visualization_msgs/msg/MarkerArray",
)


@contextlib.contextmanager
def rmw_router(port: int | None = None):
    """Run a router that passes nothing on between peers, as rmw_zenohd; yield its endpoint."""
    endpoint = f"tcp/127.0.0.1:{port or free_port()}"
    settings = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}, "delay": 0},
        "routing": {"router": {"peers_failover_brokering": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))):
        yield endpoint


def ros(endpoint: str, **settings) -> RosConfig:
    return RosConfig(connect=(endpoint,), **settings)

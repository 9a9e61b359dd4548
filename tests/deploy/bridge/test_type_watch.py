"""Nodes that speak another type than the bridge are named, with what to do."""

import pytest

from deploy.bridge.problems import LastProblem
from deploy.bridge.type_watch import TypeWatch, type_problem
from deploy.profiles import load_deploy_config
from deploy.ros2 import Node
from deploy.ros2.graph import SeenEndpoint
from deploy.ros2.messages import type_hash
from deploy.ros2.qos import RELIABLE
from deploy.routes import named_routes
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import rmw_router


@pytest.mark.parametrize("layout", ["rmw_zenoh", "ros2dds"])
def test_a_base_that_hears_another_type_of_velocities_is_named_until_it_is_gone(layout, caplog):
    with rmw_router() as endpoint:
        config = load_deploy_config(None, [f"ros.connect={endpoint}", f"ros.layout={layout}"], {}, "bare")
        with (
            LastProblem() as problems,
            Node(config.ros, "base") as base,
            Node(config.ros, "hd_bridge") as bridge,
            TypeWatch(bridge.session, config) as watch,
        ):
            bridge.publisher("/cmd_vel", "geometry_msgs/msg/Twist")
            base.publisher("/scan", "sensor_msgs/msg/LaserScan")
            base.publisher("/goal", "sensor_msgs/msg/LaserScan")
            stamped = base.subscribe("/cmd_vel", "geometry_msgs/msg/TwistStamped", lambda twist, received: None)
            base.subscribe("/cmd_vel", "geometry_msgs/msg/Twist", lambda twist, received: None)
            assert eventually(lambda: watch.problems)
            (problem,) = watch.problems.values()
            assert "speaks geometry_msgs/msg/TwistStamped on /cmd_vel, and the profile geometry_msgs/" in problem
            assert problem.endswith("set driving.message=TwistStamped")
            assert problem in caplog.text
            assert problems.problem.text == problem
            stamped.close()
            assert eventually(lambda: not watch.problems)
            assert problems.problem is None


def seen(role, topic, kind, told):
    return SeenEndpoint(role, topic, kind, told, RELIABLE, "/lidar")


def test_a_sensor_of_another_type_or_distribution_is_named():
    config = load_deploy_config(None, ["topics.scan=/front/scan"], {}, "bare")
    routes = named_routes(config)
    kind = "sensor_msgs/msg/LaserScan"
    good = type_hash(kind, "jazzy")
    assert not type_problem(config, routes, seen("publisher", "/front/scan", kind, good))
    assert not type_problem(config, routes, seen("publisher", "/scan", "sensor_msgs/msg/Image", good))
    # Whoever hears the same topic as the bridge, such as RViz, is none of its business.
    assert not type_problem(config, routes, seen("subscription", "/front/scan", "sensor_msgs/msg/Image", good))
    cloud = type_problem(config, routes, seen("publisher", "/front/scan", "sensor_msgs/msg/PointCloud2", good))
    assert cloud.endswith("no message goes between them; remap one of the two")
    humble = type_problem(config, routes, seen("publisher", "/front/scan", kind, type_hash(kind, "humble")))
    assert humble.endswith("set ros.distro to the robot's distribution")


def test_a_costmap_that_may_send_parts_of_the_map_is_named():
    config = load_deploy_config(None, ["topics.map=/global_costmap/costmap"], {}, "nav2")
    routes = named_routes(config)
    kind = "map_msgs/msg/OccupancyGridUpdate"
    part = type_problem(config, routes, seen("publisher", "/global_costmap/costmap_updates", kind, ""))
    assert "always_send_full_costmap: true" in part
    assert not type_problem(config, routes, seen("publisher", "/local_costmap/costmap_updates", kind, ""))
    assert not type_problem(config, routes, seen("subscription", "/global_costmap/costmap_updates", kind, ""))

"""Let a robot on DDS explore: the bridge, the relay, and RViz if wanted.

`ros2 launch hdplanner_ros explore.launch.py profile:=nav2 namespace:=robot1 rviz:=true`
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "profile": ("bare", "robot: bare (the bridge drives), cmu, nav2"),
    "params_file": (None, "ROS 2 parameters; those of the profile when not given"),
    "namespace": ("", "of the robot; also its name for commands"),
    "relay": ("true", "false where the RMW of the robot is rmw_zenoh_cpp"),
    "endpoint": ("tcp/127.0.0.1:7447", "where relay and bridge meet; each robot of a machine needs one of its own"),
    "rviz": ("false", "open RViz"),
    "log_level": ("info", "debug, info, warning or error"),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    share = FindPackageShare("hdplanner_ros")
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    of_profile = PathJoinSubstitution([share, "config", [value["profile"], ".yaml"]])
    declared = [
        DeclareLaunchArgument(
            name, default_value=of_profile if name == "params_file" else default, description=description
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    common = {
        "package": "hdplanner_ros",
        "namespace": value["namespace"],
        "name": "hd_bridge",
        "parameters": [value["params_file"]],
        "output": "screen",
        "ros_arguments": ["--log-level", value["log_level"]],
    }
    return LaunchDescription(
        [
            *declared,
            Node(
                executable="relay",
                arguments=["--profile", value["profile"], "--listen", value["endpoint"]],
                condition=IfCondition(value["relay"]),
                **common,
            ),
            Node(
                executable="bridge",
                arguments=["--profile", value["profile"], "--connect", value["endpoint"]],
                # A bridge whose relay comes a moment later finds it by itself.
                respawn=True,
                respawn_delay=2.0,
                **common,
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=value["namespace"],
                arguments=["-d", PathJoinSubstitution([share, "rviz", "hdplanner.rviz"])],
                condition=IfCondition(value["rviz"]),
            ),
        ]
    )

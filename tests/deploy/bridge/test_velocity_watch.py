"""A second source of velocities is warned of."""

from deploy.bridge.problems import LastProblem
from deploy.bridge.velocity_watch import VelocityWatch
from deploy.config import DeployConfig
from deploy.network_config import RosConfig
from deploy.ros2 import Node
from tests.common.bus.processes import eventually, free_port

TWIST = "geometry_msgs/msg/Twist"


def test_others_on_the_velocity_topic_are_named_and_the_bridges_own_nodes_are_not(caplog):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = DeployConfig(ros={"connect": [endpoint]})
    router = RosConfig(listen=(endpoint,), connect=())
    with (
        LastProblem() as problems,
        Node(router, "hd_bridge_watchdog") as watchdog,
        Node(config.ros, "hd_bridge") as bridge,
        VelocityWatch(bridge, config.ros, config.topics) as watch,
        Node(config.ros, "teleop") as teleop,
    ):
        for node in (watchdog, bridge):
            node.publisher("/cmd_vel", TWIST)
        teleop.publisher("/elsewhere", TWIST)
        teleop.subscribe("/cmd_vel", TWIST, lambda twist, received: None)
        late = teleop.publisher("/cmd_vel", TWIST)
        assert eventually(lambda: watch.others == {"/teleop"})
        assert "/teleop publishes on /cmd_vel as well" in caplog.text
        assert "/teleop publishes on /cmd_vel" in problems.problem.text
        late.close()
        assert eventually(lambda: not watch.others)
        assert problems.problem is None, "nobody else publishes there any more"

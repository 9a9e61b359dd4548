"""The bridge as a lifecycle node in DDS: real clients of rclpy, the relay, and a real bridge."""

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from std_msgs.msg import String

from deploy.network_config import guest_of
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network, running_bridge
from tests.deploy.relay.network import dds_node, repeat, robot, running_relay

# A fresh install compiles its kernels for some minutes.
pytestmark = pytest.mark.timeout(400)
MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


class Manager:
    """Calls the services, as `ros2 lifecycle` and nav2's manager do."""

    def __init__(self, node):
        self._clients = {
            kind: node.create_client(kind, f"/hd_bridge/{name}")
            for kind, name in (
                (GetState, "get_state"),
                (ChangeState, "change_state"),
                (GetAvailableTransitions, "get_available_transitions"),
            )
        }
        assert all(client.wait_for_service(20.0) for client in self._clients.values())

    def call(self, kind, request=None):
        future = self._clients[kind].call_async(request or kind.Request())
        assert eventually(future.done, 20.0)
        return future.result()

    def state(self):
        return self.call(GetState).current_state.id

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(ChangeState, request).success


def test_a_manager_in_dds_brings_the_bridge_up_and_down(domain):
    router, config = network(mapping=MAPPING, ros={"domain": domain})
    router = router.model_copy(update={"domain": domain})
    relayed = config.model_copy(update={"ros": guest_of(config.ros)})
    with (
        FakeRobot(ARMS, router) as fake,
        running_bridge(config) as (_, thread),
        running_relay(relayed),
        dds_node("manager", domain) as node,
    ):
        manager, told, answers = Manager(node), [], []
        node.create_subscription(DiagnosticArray, "/diagnostics", told.append, 10)
        node.create_subscription(String, "/hd/acknowledgement", lambda text: answers.append(text.data), 10)
        goals = node.create_publisher(PointStamped, "/goal_point", 10)
        assert eventually(lambda: fake.status.get("scans", 0) > 2)
        assert manager.state() == State.PRIMARY_STATE_INACTIVE
        assert manager.change(Transition.TRANSITION_CONFIGURE)
        assert manager.change(Transition.TRANSITION_ACTIVATE)
        assert manager.state() == State.PRIMARY_STATE_ACTIVE
        found = manager.call(GetAvailableTransitions).available_transitions
        assert {one.transition.label for one in found} == {"deactivate", "shutdown"}
        # A goal in DDS takes the robot out of its exploration.
        goal = PointStamped()
        goal.header.frame_id, goal.point.x, goal.point.y = "map", fake.pose.x, fake.pose.y
        assert repeat(lambda: goals.publish(goal), lambda: answers)
        assert eventually(lambda: fake.status["task"] == "navigation")
        assert eventually(lambda: told)
        assert {one.name.split(": ")[1] for one in told[-1].status} == {"task", "inputs", "planner", "watchdog"}
        fake.say("explore")
        assert eventually(lambda: fake.status["task"] == "exploration")
        assert manager.change(Transition.TRANSITION_DEACTIVATE)
        assert manager.change(Transition.TRANSITION_CLEANUP)
        assert manager.state() == State.PRIMARY_STATE_UNCONFIGURED
        assert not manager.change(Transition.TRANSITION_ACTIVATE)
        assert manager.change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        thread.join(10.0)
        assert not thread.is_alive()


def test_a_bridge_that_is_not_there_has_no_state(domain):
    with running_relay(robot(domain)), dds_node("manager", domain) as node:
        manager = Manager(node)
        assert manager.state() == State.PRIMARY_STATE_UNKNOWN
        assert not manager.change(Transition.TRANSITION_ACTIVATE)

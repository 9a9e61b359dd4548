"""Targets as nav2's action, by clients that speak its services and topics."""

import threading
import uuid

import pytest

from common.bus.control import request
from common.geometry import Pose
from deploy.ros2 import QoS, message
from deploy.ros2.conversions import pose_stamped
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network, running_bridge

KIND = "nav2_msgs/action/NavigateToPose"
NAME = "/hd_bridge/navigate_to_pose/_action"
MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


class ActionClient:
    """Sends goals and waits for their results, as nav2's commander does."""

    def __init__(self, node):
        self._node = node
        self.feedback, self.statuses = [], []
        node.subscribe(f"{NAME}/feedback", f"{KIND}_FeedbackMessage", lambda told, how: self.feedback.append(told))
        latched = QoS(transient_local=True, depth=1)
        node.subscribe(
            f"{NAME}/status", "action_msgs/msg/GoalStatusArray", lambda told, how: self.statuses.append(told), latched
        )

    def call(self, name, kind, timeout=10.0, **fields):
        client = self._node.client(f"{NAME}/{name}", kind)
        return client.call(message(f"{kind}_Request", **fields), timeout)

    def send(self, x, y, frame="map"):
        goal_id = message("unique_identifier_msgs/msg/UUID", uuid=list(uuid.uuid4().bytes))
        goal = message(f"{KIND}_Goal", pose=pose_stamped(1.0, frame, Pose(x, y)))
        return goal_id, self.call("send_goal", f"{KIND}_SendGoal", goal_id=goal_id, goal=goal).accepted

    def result(self, goal_id, timeout=60.0):
        """Asks at once, and gets the answer in a list when there is one."""
        answers = []
        threading.Thread(
            target=lambda: answers.append(self.call("get_result", f"{KIND}_GetResult", timeout, goal_id=goal_id)),
            daemon=True,
        ).start()
        return answers

    def cancel(self, goal_id):
        info = message("action_msgs/msg/GoalInfo", goal_id=goal_id)
        return self.call("cancel_goal", "action_msgs/srv/CancelGoal", goal_info=info)


@pytest.fixture(scope="module")
def pair():
    router, config = network(mapping=MAPPING)
    with FakeRobot(ARMS, router, speed=4.0) as robot, running_bridge(config):
        assert eventually(lambda: robot.status.get("scans", 0) > 2)
        yield robot, ActionClient(robot.node)


def test_a_goal_is_reached_and_whoever_sent_it_hears_of_it(pair):
    robot, client = pair
    x, y = ARMS.start
    request(robot.node.session, "robot", "start", 10.0)
    assert eventually(lambda: robot.driven > 3.0, 30.0)
    goal_id, accepted = client.send(x, y)
    assert accepted
    answers = client.result(goal_id)
    assert eventually(lambda: answers, 60.0)
    assert (answers[0].status, answers[0].result.error_code) == (SUCCEEDED, 0)
    assert robot.pose.distance_to((x, y)) <= 1.0
    assert client.feedback
    assert eventually(lambda: client.statuses[-1].status_list[-1].status == SUCCEEDED)


def test_a_goal_that_is_canceled_leaves_a_robot_that_stands(pair):
    robot, client = pair
    goal_id, accepted = client.send(ARMS.start[0] + 30.0, ARMS.start[1])
    assert accepted
    answers = client.result(goal_id)
    assert client.cancel(goal_id).return_code == 0
    assert eventually(lambda: answers)
    assert answers[0].status == CANCELED
    assert robot.status["state"] == "aborted"
    assert client.cancel(goal_id).return_code == 3, "it is over"
    assert client.cancel(message("unique_identifier_msgs/msg/UUID", uuid=[1] * 16)).return_code == 2, "nobody knows it"


def test_another_order_aborts_a_goal(pair):
    robot, client = pair
    goal_id, _ = client.send(ARMS.start[0] + 30.0, ARMS.start[1])
    answers = client.result(goal_id)
    request(robot.node.session, "robot", "explore", 10.0)
    assert eventually(lambda: answers)
    assert (answers[0].status, answers[0].result.error_msg) == (ABORTED, "another command arrived")
    first, _ = client.send(ARMS.start[0] + 30.0, ARMS.start[1])
    answers = client.result(first)
    assert client.send(ARMS.start[0] + 31.0, ARMS.start[1])[1]
    assert eventually(lambda: answers)
    assert answers[0].status == ABORTED


def test_a_goal_does_not_end_a_pause(pair):
    robot, client = pair
    assert client.send(ARMS.start[0] + 30.0, ARMS.start[1])[1]
    request(robot.node.session, "robot", "pause", 10.0)
    goal_id, accepted = client.send(*ARMS.start)
    assert accepted
    answers = client.result(goal_id)
    assert request(robot.node.session, "robot", "status", 10.0)["state"] == "paused"
    request(robot.node.session, "robot", "resume", 10.0)
    assert eventually(lambda: answers, 60.0)
    assert answers[0].status == SUCCEEDED


def test_goals_that_cannot_be_meant_are_rejected(pair):
    _, client = pair
    assert not client.send(1.0, 1.0, frame="odom")[1]
    assert not client.send(5e6, 1.0)[1]

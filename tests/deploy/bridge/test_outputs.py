"""What a stack that drives the robot hears of where it is to go, on a real bus and in counted time."""

from dataclasses import replace
from itertools import count

import pytest

from common.geometry import Pose
from deploy.bridge.mission import Orders, Phase
from deploy.bridge.outcome import Course, Outcome
from deploy.bridge.outputs import Outputs
from deploy.network_config import RosConfig
from deploy.profiles import load_deploy_config
from deploy.ros2 import Node
from deploy.ros2.conversions import pose_from_stamped
from tests.common.bus.processes import eventually, free_port

HERE = Pose(1.0, 2.0)
WAYPOINT = (4.0, 2.0)


@pytest.fixture
def nodes():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        Node(RosConfig(listen=(endpoint,), connect=(), node="bridge")) as bridge,
        Node(RosConfig(connect=(endpoint,), node="nav2")) as nav2,
    ):
        yield bridge, nav2


@pytest.fixture
def stack(nodes):
    """What the bridge says with the profile of nav2, and the places to which nav2 is sent."""
    outputs, goals = Outputs(nodes[0], load_deploy_config(profile="nav2")), []
    nodes[1].subscribe("/goal_pose", "geometry_msgs/msg/PoseStamped", lambda m, _: goals.append(place(m)))
    assert eventually(lambda: outputs._publishers["waypoint_pose"].heard)
    return outputs, goals


def place(goal):
    return tuple(round(number, 3) for number in pose_from_stamped(goal)[1].position)


def outcome(pose, *, going=True):
    orders = Orders(Phase.RUNNING)
    course = Course(WAYPOINT, None, (), (), (WAYPOINT,), True, "") if going else None
    return Outcome(
        orders=orders, hold="", course=course, aim=None, planner="", relieved="", decided=False, seconds=0.0,
        faults=(), mapper=None, pose=pose, checks=0, bans=(), unseen=None,
    )  # fmt: skip


def drive(outputs, poses, begin=0.0):
    """One pass in each tenth of a second."""
    for number, pose in enumerate(poses):
        outputs.decision(outcome(pose), begin + number / 10, begin + number / 10)


def test_a_robot_whose_pose_is_lost_is_sent_to_where_it_was_last(stack):
    outputs, goals = stack
    outputs.decision(outcome(HERE), 0.0, 0.0)
    outputs.decision(outcome(None, going=False), 0.1, 0.1)
    assert eventually(lambda: goals == [WAYPOINT, HERE.position])
    # The same waypoint once more is news to a stack that was told to stand.
    outputs.decision(outcome(HERE), 0.2, 0.2)
    assert eventually(lambda: goals == [WAYPOINT, HERE.position, WAYPOINT])


def test_a_robot_that_stands_is_told_its_goal_again(stack):
    outputs, goals = stack
    drive(outputs, [HERE] * 215)
    assert eventually(lambda: goals == [WAYPOINT] * 3), "at once, after 10 s, and after 10 more"


def test_a_robot_that_moves_or_turns_is_told_its_goal_once(stack):
    outputs, goals = stack
    drive(outputs, [replace(HERE, x=1.0 + 0.02 * tick) for tick in range(130)])
    drive(outputs, [replace(HERE, yaw=0.03 * tick) for tick in range(130)], begin=13.0)
    # One that was held in between begins to count anew.
    outputs.decision(outcome(HERE, going=False), 26.0, 26.0)
    drive(outputs, [HERE] * 90, begin=26.1)
    assert eventually(lambda: len(goals) == 3)
    assert goals == [WAYPOINT, HERE.position, WAYPOINT]


@pytest.mark.parametrize(
    ("profile", "topic", "kind"),
    [("nav2", "/goal_pose", "PoseStamped"), ("cmu", "/way_point", "PointStamped")],
)
def test_a_stack_that_does_not_run_is_named_until_it_does(nodes, profile, topic, kind):
    bridge, robot = nodes
    outputs = Outputs(bridge, load_deploy_config(profile=profile))
    assert outputs.unheard(0.0) == outputs.unheard(2.9) == "", "a link may only be away for a moment"
    assert outputs.unheard(3.1).startswith(f"nobody listens on {topic} to where the robot is to go: start the stack")
    listens = robot.subscribe(topic, f"geometry_msgs/msg/{kind}", lambda *_: None)
    assert eventually(lambda: outputs.unheard(4.0) == "")
    listens.close()
    seconds = count(8.0, 4.0)
    assert eventually(lambda: outputs.unheard(next(seconds)) != "")


def test_a_robot_that_the_bridge_drives_needs_no_stack(nodes):
    outputs = Outputs(nodes[0], load_deploy_config(profile="bare"))
    assert outputs.unheard(0.0) == outputs.unheard(100.0) == ""


def test_a_base_that_hears_no_velocities_is_named_until_it_does(nodes):
    outputs = Outputs(nodes[0], load_deploy_config(None, ["topics.velocity=base/cmd_vel"], {}, "bare"))
    assert outputs.unheard(0.0, velocity_heard=False) == outputs.unheard(2.9, velocity_heard=False) == ""
    told = outputs.unheard(3.1, velocity_heard=False)
    assert told.startswith("nobody listens on /base/cmd_vel to velocities of the type Twist: start the driver")
    assert outputs.unheard(3.2, velocity_heard=True) == ""

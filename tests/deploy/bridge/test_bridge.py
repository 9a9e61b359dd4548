"""A bridge on a real bus, with a small robot at the other end: topics, commands, and what happens when things fail."""

import contextlib
import os
import signal
import threading
import time
from dataclasses import replace

import pytest

from common.bus.control import request
from common.bus.liveness import present
from common.errors import BusError
from common.geometry import Pose
from common.messages.replies import ROBOT_VERBS
from deploy.bridge.bridge import Bridge
from deploy.ros2 import LATCHED, message
from deploy.ros2.conversions import point_stamped
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network, running_bridge

OPERATOR = {"who": "anna", "why": "the hall is empty"}
MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


@pytest.fixture(scope="module")
def pair():
    router, config = network(mapping=MAPPING)
    stop = threading.Event()
    with FakeRobot(ARMS, router) as robot, Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        yield robot, bridge
        stop.set()
        thread.join()
    assert bridge.status()["lifecycle"] == "finalized"


@pytest.fixture
def robot(pair):
    """The robot at its start, and a bridge that waits with an empty map."""
    robot = pair[0]
    robot.sensing, robot.jump = True, None
    robot.spoil_odometry = lambda odometry: odometry
    ask(robot, "abort")
    robot.carry_to(Pose(*ARMS.start))
    ask(robot, "reset")
    ask(robot, "release", **OPERATOR)
    robot.waypoints.clear()
    robot.answers.clear()
    # A robot that was carried back has a pose that jumped.
    assert eventually(lambda: robot.status.get("faults") == {} and robot.status["scans"] > 2)
    return robot


def ask(robot, verb, **arguments):
    return request(robot.node.session, "robot", verb, 10.0, arguments, asked="robot")


def state(robot):
    return robot.status.get("state")


def test_it_explores_and_tells_everything_about_it(robot):
    assert ask(robot, "start")["lifecycle"] in {"inactive", "active"}
    assert eventually(lambda: len(set(robot.waypoints)) >= 3, 30)
    status = robot.status
    assert (status["state"], status["lifecycle"], status["planner"]) == ("running", "active", "hdplanner")
    assert status["explored_area"] > 20.0
    assert status["viewpoints"] > 3
    assert status["decision_seconds"] > 0.0
    assert status["ages"]["scan"] < 3.0
    assert status["home"] == pytest.approx(list(ARMS.start), abs=1.0)
    assert eventually(lambda: robot.status["distance"] > 0.2 and robot.status["duration"] > 0.0)
    wanted = {"/hd/path", "/hd/beacon", "/hd/markers", "/hd/belief", "/runtime", "/traveling_distance"}
    assert eventually(lambda: wanted <= set(robot.heard))
    assert {marker.ns for marker in robot.heard["/hd/markers"].markers} >= {"edges", "frontiers", "beacons", "waypoint"}
    assert robot.heard["/hd/belief"].info.resolution == pytest.approx(0.25)
    assert robot.heard["/hd/path"].header.frame_id == "map"
    assert robot.heard["/exploration_finish"].data is False
    assert ("robot", "robot") in present(robot.node.session, "robot")


def test_every_command_is_acknowledged_on_the_bus(robot):
    seen = {verb: ask(robot, verb) for verb in ("status", "start", "pause", "resume")}

    def return_home():
        # Home is where the first decision was made, which takes a moment.
        with contextlib.suppress(BusError):
            seen["return_home"] = ask(robot, "return_home")
        return "return_home" in seen

    assert eventually(return_home)
    seen["abort"] = ask(robot, "abort")
    assert [seen[verb]["state"] for verb in ("status", "pause", "abort")] == ["aborted", "paused", "aborted"]
    assert ask(robot, "stop", reason="test")["name"] == "robot"
    assert eventually(lambda: ask(robot, "status")["emergency_stop"])
    with pytest.raises(BusError, match="emergency stop is latched: release it first"):
        ask(robot, "start")
    with pytest.raises(BusError, match="requires a name and the reason why"):
        ask(robot, "release")
    assert ask(robot, "status")["emergency_stop"]
    ask(robot, "release", **OPERATOR)
    assert eventually(lambda: not ask(robot, "status")["emergency_stop"])
    assert ask(robot, "reset")["state"] == "aborted"
    with pytest.raises(BusError, match=r"refused 'pause': there is nothing to pause"):
        ask(robot, "pause")
    x, y = robot.pose.position
    assert ask(robot, "goal", x=x + 1.0, y=y)["state"] == "idle"
    assert ask(robot, "explore")["state"] == "idle"
    assert set(ROBOT_VERBS) == {*seen, "stop", "release", "reset", "goal", "explore"}


def test_every_command_is_acknowledged_on_topics(robot):
    robot.starts.publish(message("std_msgs/msg/Bool", data=True))
    assert eventually(lambda: len(robot.answers) == 1)
    for text in ("pause", "resume", "return-home", "status", "abort", "goal 1 2000", "dance", "pause now"):
        count = len(robot.answers)
        robot.say(text)
        assert eventually(lambda count=count: len(robot.answers) > count), text
    robot.goals.publish(point_stamped(time.time(), "odom", (1.0, 2.0)))
    assert eventually(lambda: len(robot.answers) == 10)
    by_command = {answer["command"]: answer for answer in robot.answers}
    assert [by_command[c]["ok"] for c in ("start", "pause", "resume", "return-home", "abort")] == [True] * 5
    assert by_command["pause"]["state"] == "paused"
    assert "within 500 m of the robot" in by_command["goal 1 2000"]["error"]
    assert "must be one of status, start" in by_command["dance"]["error"]
    assert "takes no arguments" in by_command["pause now"]["error"]
    assert "in the frame 'map', got 'odom'" in by_command["goal"]["error"]


def test_lost_scans_stop_the_robot_and_scans_let_it_go_on(robot):
    ask(robot, "start")
    assert eventually(lambda: robot.waypoint is not None and state(robot) == "running", 30)
    robot.sensing = False
    assert eventually(lambda: bool(robot.stops) and robot.stops[-1][1] == 2, 10)
    assert eventually(lambda: state(robot) == "holding" and "sensor_stale" in robot.status["faults"])
    # A stack of its own is sent to where the robot was last seen.
    assert eventually(lambda: robot.waypoint == pytest.approx(tuple(robot.status["pose"][:2]), abs=0.01))
    robot.sensing = True
    assert eventually(lambda: state(robot) == "running" and robot.stops[-1][1] == 0)


def test_a_jump_of_the_pose_stops_the_robot(robot):
    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running" and robot.stops[-1][1] == 0, 30)
    robot.jump = 8.0
    assert eventually(lambda: robot.stops[-1][1] == 2, 5)
    assert eventually(lambda: "jumped" in robot.status["reason"])


def test_an_odometry_that_begins_anew_holds_the_robot_until_it_is_put_right_or_the_map_is_reset(robot):
    def beside(odometry):
        odometry.pose.pose.position.y += 3.3
        return odometry

    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running" and robot.status["explored_area"] > 50.0, 30)
    home, scans = robot.status["home"], robot.status["scans"]
    robot.spoil_odometry = beside
    assert eventually(lambda: "does not fit its map any more" in robot.status["reason"], 10)
    # A jump alone would be over then.
    assert eventually(lambda: list(robot.status["faults"]) == ["map_misplaced"], 10)
    time.sleep(0.5)
    assert (state(robot), list(robot.status["faults"])) == ("holding", ["map_misplaced"])
    assert robot.status["scans"] - scans < 15, "nothing is drawn over the map"
    robot.spoil_odometry = lambda odometry: odometry
    assert eventually(lambda: state(robot) == "running" and robot.status["home"] == home, 10)
    robot.spoil_odometry = beside
    assert eventually(lambda: "does not fit its map any more" in robot.status["reason"], 10)
    ask(robot, "reset")
    assert eventually(lambda: state(robot) == "running" and robot.status["home"] not in (None, home), 10)


def test_the_emergency_stop_holds_until_an_operator_releases_it_and_then_until_a_start(robot):
    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running" and robot.stops[-1][1] == 0, 30)
    robot.emergency.publish(message("std_msgs/msg/Bool", data=True))
    assert eventually(lambda: robot.stops[-1][1] == 2, 5)
    robot.emergency.publish(message("std_msgs/msg/Bool", data=False))
    assert eventually(lambda: state(robot) == "aborted" and "emergency stop" in robot.status["reason"])
    assert robot.status["reason"].count("emergency stop") == 1, "said once, and by whom"
    assert ask(robot, "status")["emergency_stop"]
    robot.say("release")
    assert eventually(lambda: robot.answers and "no topic releases the emergency stop" in robot.answers[-1]["error"])
    robot.starts.publish(message("std_msgs/msg/Bool", data=True))
    assert eventually(lambda: "latched: release it first" in robot.answers[-1]["error"])
    assert ask(robot, "status")["emergency_stop"]
    assert ask(robot, "release", **OPERATOR)["state"] == "aborted"
    here = robot.pose
    time.sleep(1.5)
    assert (robot.stops[-1][1], robot.pose, state(robot)) == (2, here, "aborted"), "a release moves nothing"
    with pytest.raises(BusError, match="nothing to resume"):
        ask(robot, "resume")
    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running" and robot.stops[-1][1] == 0)


def test_a_pause_stops_the_robot_and_an_idle_robot_is_left_to_others(robot):
    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running" and robot.stops[-1][1] == 0, 30)
    ask(robot, "pause")
    assert eventually(lambda: robot.stops[-1][1] == 2, 5)
    assert robot.status["lifecycle"] == "inactive" or eventually(lambda: robot.status["lifecycle"] == "inactive")
    ask(robot, "resume")
    assert eventually(lambda: robot.stops[-1][1] == 0)


def test_an_emergency_stop_reaches_a_robot_whose_watchdog_has_just_died(pair, robot):
    gate = pair[1]._gate
    os.kill(gate.pid, signal.SIGKILL)
    robot.emergency.publish(message("std_msgs/msg/Bool", data=True))
    assert eventually(lambda: ask(robot, "status")["emergency_stop"], 0.5)
    assert eventually(lambda: gate.state.alive, 20)
    assert eventually(lambda: robot.status["gate"] == "emergency_stop")


@pytest.mark.timeout(120)
def test_a_robot_whose_stack_does_not_run_holds_and_says_so_until_it_does():
    router, config = network(
        mapping=MAPPING,
        topics={"stop": "/stop", "waypoint_pose": "/goal_pose"},
        decision={"planner": "nearest"},
        safety={"scan_timeout": 3.0, "pose_timeout": 3.0, "progress_time": 1.0},
    )
    goals = []
    with FakeRobot(ARMS, router) as robot, running_bridge(config):
        assert eventually(lambda: robot.status.get("scans", 0) > 2, 30)
        ask(robot, "start")
        assert eventually(lambda: robot.status["reason"].startswith("nobody listens on /goal_pose"))
        # That is no time in which places turn out to be out of reach.
        time.sleep(2.0)
        assert (state(robot), robot.status["bans"]) == ("holding", 0)
        robot.node.subscribe("/goal_pose", "geometry_msgs/msg/PoseStamped", lambda m, _: goals.append(m))
        assert eventually(lambda: state(robot) == "running" and goals, 45.0)


@pytest.mark.timeout(120)
def test_a_base_that_hears_another_type_of_velocities_holds_the_robot_and_is_named():
    router, config = network(
        mapping={**MAPPING, "robot_radius": 0.3},
        decision={"planner": "nearest"},
        driving={"enabled": True, "robot_radius": 0.2},
    )
    with FakeRobot(ARMS, router, by_velocity=True) as robot:
        heard = []
        stamped = config.driving.model_copy(update={"message": "TwistStamped"})
        with running_bridge(config.model_copy(update={"driving": stamped})):
            assert eventually(lambda: robot.status.get("scans", 0) > 2, 30)
            ask(robot, "start")
            what = "nobody listens on /cmd_vel to velocities of the type TwistStamped"
            assert eventually(lambda: robot.status["reason"].startswith(what))
            assert robot.status["error"]["text"].endswith("set driving.message=Twist")
            robot.node.subscribe("/cmd_vel", "geometry_msgs/msg/TwistStamped", lambda m, _: heard.append(m))
            assert eventually(lambda: heard and not robot.status["reason"].startswith(what))


@pytest.mark.timeout(120)
def test_a_stop_latched_before_the_start_outlives_autostart():
    router, config = network(mapping=MAPPING, decision={"planner": "nearest", "autostart": True})
    stop = threading.Event()
    with FakeRobot(ARMS, router) as robot:
        # A button latches its message, and nobody presses it again for a bridge that starts later.
        button = robot.node.publisher(config.topics.emergency_stop, "std_msgs/msg/Bool", LATCHED)
        button.publish(message("std_msgs/msg/Bool", data=True))
        robot.sensing = False
        with Bridge(config) as bridge:
            thread = threading.Thread(target=bridge.run, args=(stop,))
            thread.start()
            try:
                assert eventually(lambda: robot.status.get("emergency_stop"))
                robot.sensing = True
                assert eventually(lambda: robot.status["scans"] > 3)
                ask(robot, "release", **OPERATOR)
                time.sleep(1.0)
                assert (state(robot), robot.status["reason"]) == ("idle", "waits for the command to start")
                ask(robot, "start")
                assert eventually(lambda: state(robot) == "running")
            finally:
                stop.set()
                thread.join()


def test_the_answer_to_a_command_does_not_repeat_what_held_the_robot_before_it(pair, robot):
    bridge = pair[1]
    ask(robot, "start")
    assert eventually(lambda: state(robot) == "running", 30)
    told = []

    def answered_at_once():
        # Between two passes of the decision loop.
        bridge._outcome = replace(bridge._outcome, hold="something closes the way", course=None)
        told.append(ask(robot, "return_home"))
        ask(robot, "explore")
        return told[-1]["state"] == "returning"

    assert eventually(answered_at_once, 10)
    assert all("closes the way" not in answer["reason"] for answer in told)

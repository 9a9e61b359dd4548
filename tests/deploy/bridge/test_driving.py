"""A bridge that drives by itself: velocities on the bus, through the watchdog."""

import threading
import time

import numpy as np
import pytest

from deploy.bridge.bridge import Bridge
from deploy.ros2 import message
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import DEAD_END
from tests.deploy.bridge.robots import FakeRobot, network, running_bridge

MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


@pytest.mark.timeout(180)
def test_it_drives_by_velocities_and_a_pause_is_zero_velocity():
    router, config = network(
        mapping={**MAPPING, "robot_radius": 0.2},
        driving={"enabled": True, "robot_radius": 0.2},
        topics={"stop": "", "velocity": "/cmd_vel"},
    )
    stop = threading.Event()
    with FakeRobot(DEAD_END, router, by_velocity=True) as robot, Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        try:
            assert eventually(lambda: bool(robot.status) and robot.status["scans"] > 3)
            assert all(velocity == (0.0, 0.0) for _, velocity in robot.velocities)
            start = robot.pose
            robot.say("start")
            assert eventually(lambda: start.distance_to(robot.pose.position) > 1.0, 60)
            assert max(linear for _, (linear, _) in robot.velocities) <= config.driving.max_speed + 1e-6
            robot.say("pause")
            assert eventually(lambda: robot.answers[-1]["command"] == "pause")
            told = time.monotonic()
            assert eventually(lambda: robot.velocities[-1][1] == (0.0, 0.0), 5)
            assert time.monotonic() - told < 2.0
            here = robot.pose
            time.sleep(0.5)
            assert here.distance_to(robot.pose.position) < 0.05
            robot.say("resume")
            assert eventually(lambda: here.distance_to(robot.pose.position) > 0.5, 60)
        finally:
            stop.set()
            thread.join()
    assert robot.velocities[-1][1] == (0.0, 0.0)


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_way_is_not_blocked_while_an_operator_holds_the_stick():
    router, config = network(
        mapping={**MAPPING, "robot_radius": 0.2},
        driving={"enabled": True, "robot_radius": 0.2},
        topics={"stop": "", "velocity": "/cmd_vel"},
        decision={"autostart": True},
    )
    with FakeRobot(DEAD_END, router, by_velocity=True) as robot, running_bridge(config):
        joystick = robot.node.publisher(config.topics.joy, "sensor_msgs/msg/Joy")
        start = robot.pose
        assert eventually(lambda: start.distance_to(robot.pose.position) > 0.5, 60)
        stick = np.array([0.0, 0.7, 0.0, 0.0, 0.0], np.float32)
        joystick.publish(message("sensor_msgs/msg/Joy", axes=stick))
        assert eventually(lambda: robot.status["gate"] == "overridden")
        since = len(robot.statuses)
        # The local planner reports a blocked way after 7 s in which the robot does not do what it is told.
        time.sleep(9.0)
        assert {(status["gate"], status["bans"]) for status in robot.statuses[since:]} == {("overridden", 0)}
        here = robot.pose
        joystick.publish(message("sensor_msgs/msg/Joy", axes=0.0 * stick))
        assert eventually(lambda: here.distance_to(robot.pose.position) > 0.5, 60)

"""The life of the simulated robot: step, publish, keep pace, until it is told to stop."""

from __future__ import annotations

import logging
import threading
import time

from deploy.config import DeployConfig
from deploy.robot.interface import RobotInterface
from deploy.robot.options import RobotOptions
from deploy.robot.pace import Pace
from deploy.robot.simulation import SimulatedRobot
from deploy.ros2 import Node

log = logging.getLogger(__name__)

NODE_NAME = "hd_robot"
_SLOW = 0.8
_REPORT_SECONDS = 10.0


def run_robot(options: RobotOptions, config: DeployConfig, stop: threading.Event, seconds: float | None = None) -> None:
    """Simulate a robot until `stop` is set.

    Args:
        options: the robot and its world.
        config: topics, frames and endpoints.
        stop: set by a signal's handler.
        seconds: end after so many seconds of the robot.

    Raises:
        HDError: the world, the simulator or the network cannot be used.
    """
    with SimulatedRobot(options, config) as robot, Node(config.ros, NODE_NAME) as node:
        interface = RobotInterface(node, robot, config)
        log.info("the robot lives in %s; %s", robot.world.name, _description(robot, config))
        ros = config.ros
        log.info("Zenoh %s %s", "router at" if ros.listen else "at", ", ".join(ros.listen or ros.connect))
        pace = Pace(options.speed_factor)
        report = _REPORT_SECONDS
        while not stop.is_set() and (seconds is None or robot.time < seconds):
            interface.publish(robot.step(time.monotonic()), pace.reached)
            pace.wait(robot.time, stop)
            if pace.reached < _SLOW * options.speed_factor and robot.time >= report:
                log.warning("the simulation reaches %.2f times real time of %g", pace.reached, options.speed_factor)
                report = robot.time + 6.0 * _REPORT_SECONDS
        log.info("%.1f s, %.1f m, %d collisions", robot.time, robot.distance, robot.collisions)


def _description(robot: SimulatedRobot, config: DeployConfig) -> str:
    width, height = robot.world.size
    topics = config.topics
    senses = ", ".join(topic for topic in (topics.odometry, topics.scan, topics.points, topics.map) if topic)
    drive = (
        f"drives to {topics.waypoint_pose or topics.waypoint} itself"
        if robot.follower is not None
        else f"takes velocities from {topics.velocity}"
    )
    target = robot.world.target
    where = "" if target is None else f", target at ({target[0]:.1f}, {target[1]:.1f})"
    return f"{width:.0f} m x {height:.0f} m{where}; publishes {senses}; {drive}"

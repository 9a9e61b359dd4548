"""A small closed-loop world: a robot in two rooms that drives where the replayed decision loop sends it."""

import json
from pathlib import Path

import numpy as np

from common.geometry import Pose, Scan
from common.mapping.raycast import cast_rays, ray_angles
from deploy.config import DeployConfig
from deploy.profiles import load_deploy_config
from deploy.recording.bag_player import BagPlayer
from deploy.recording.reader import Recorded
from deploy.recording.writer import BagWriter
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, message
from deploy.ros2.conversions import laser_scan, odometry, point_stamped
from deploy.ros2.messages import serialize

BEGIN = 1_700_000_000.0
CELL = 0.1
BEAMS = 180
STEP = 2.0 * np.pi / BEAMS
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
POINT, STRING = "geometry_msgs/msg/PointStamped", "std_msgs/msg/String"
QUALITY = {"/scan": SENSOR, "/map": LATCHED}


def config(*overrides: str) -> DeployConfig:
    return load_deploy_config(None, ["mapping.sensor_range=6", *overrides], profile="bare")


def rooms() -> np.ndarray:
    free = np.zeros((100, 160), np.bool_)
    free[5:95, 5:78] = True
    free[5:95, 82:155] = True
    free[45:57, 76:84] = True
    return free


def recorded(topic: str, kind: str, seconds: float, value) -> Recorded:
    return Recorded(topic, kind, round((BEGIN + seconds) * 1e9), serialize(value, kind))


def explore(settings: DeployConfig, seconds: float = 20.0) -> list[Recorded]:
    """Let the decision loop drive a robot, and return what went over the topics: sensors, waypoints, status."""
    free, angles = rooms(), ray_angles(0.0, 0.0, STEP, BEAMS)
    position, goal = np.array([2.0, 2.0]), None
    sent: list[Recorded] = []
    clock = 0.0

    def sensors():
        nonlocal position, clock
        yield from keep(recorded("/hd/status", STRING, 0.0, status("running")))
        for tick in range(round(seconds * 10)):
            clock = tick * 0.1
            if goal is not None:
                way = np.asarray(goal) - position
                length = np.hypot(*way)
                position = position + way / max(length, 1e-9) * min(0.1, length)
            x, y = map(float, position)
            where = odometry(BEGIN + clock, "map", "base_link", Pose(x, y))
            ranges = cast_rays(free, CELL, 0.0, 0.0, x, y, angles, 6.0)
            scan = laser_scan(BEGIN + clock, "base_link", Scan(ranges, 0.0, STEP, 6.0))
            yield from keep(recorded("/odom", ODOMETRY, clock, where))
            yield from keep(recorded("/scan", SCAN, clock + 0.01, scan))

    def keep(one):
        sent.append(one)
        yield one

    def listen(outcome, now):
        nonlocal goal
        goal = None if outcome.course is None else outcome.course.waypoint
        if goal is not None:
            sent.append(recorded("/way_point", POINT, clock + 0.05, point_stamped(now, "map", goal)))

    BagPlayer(settings, self_start=False, listener=listen).run(sensors())
    return sorted(sent, key=lambda one: one.time)


def status(state: str, **more):
    return message(STRING, data=json.dumps({"state": state, "target": None, **more}))


def write(path: Path, messages: list[Recorded], settings: DeployConfig | None = None) -> Path:
    with BagWriter(path, config=settings) as bag:
        channels: dict[str, int] = {}
        for one in messages:
            if one.topic not in channels:
                channels[one.topic] = bag.add_topic(one.topic, one.kind, QUALITY.get(one.topic, RELIABLE))
            bag.write(channels[one.topic], one.payload, one.time)
    return path

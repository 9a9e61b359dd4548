"""The page of a real bridge on a real bus, through a client that knows the documents alone."""

import json
import threading

import numpy as np
import pytest

from common.page.options import PageSettings
from deploy.bridge.bridge import Bridge
from deploy.page.process import start_page
from deploy.ros2 import Node, message
from deploy.ros2.conversions import grid_from
from tests.common.bus.processes import eventually
from tests.common.page.reader import Reader
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network

pytest.importorskip("starlette", reason="the extra `page` is not installed")
TOKEN = "let-me-command"
OPERATOR = {"who": "anna", "why": "the hall is empty"}
MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


@pytest.fixture(scope="module")
def world():
    router, config = network(mapping=MAPPING, decision={"markers_rate": 5.0})
    stop = threading.Event()
    with (
        FakeRobot(ARMS, router) as robot,
        Bridge(config) as bridge,
        start_page(PageSettings(0, token=TOKEN, rate=20.0), config) as page,
    ):
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        yield robot, page.address, config
        stop.set()
        thread.join()


def of(reader, name, robot="robot"):
    return reader.values.get(f"robot/{robot}/{name}")


def state(reader):
    return (of(reader, "status") or {}).get("state")


def test_a_robot_is_seen_commanded_and_stopped(world):
    robot, address, _ = world
    with Reader(address, TOKEN) as reader:
        reader.until(lambda: (of(reader, "status") or {}).get("scans", 0) > 2, 60)
        assert reader.values["robots"] == [{"name": "robot", "silent": False}]
        assert reader.command("start", "robot")["ok"]
        reader.until(lambda: state(reader) == "running" and len(reader.series["robot/robot/way"][0]) > 10, 60)
        assert reader.command("pause", "robot")["state"]["state"] == "paused"

        # The belief that was put together of blocks is the belief.
        def agrees():
            cells, _, (x, y, _) = grid_from(robot.heard["/hd/belief"])
            return np.array_equal(reader.grids["robot/robot/belief"].cells(cells.shape, (x, y)), cells)

        reader.until(agrees, 60)
        assert reader.grids["robot/robot/belief"].frames > 3
        reader.until(lambda: robot.pose.distance_to(tuple(of(reader, "pose")[:2])) < 0.01)
        scan = np.array(of(reader, "scan")).reshape(-1, 2) / 100.0
        assert 10 < len(scan) <= 400
        assert np.hypot(*(scan - robot.pose.position).T).max() <= 10.5
        scene = of(reader, "scene")
        assert len(scene["viewpoints"]) % 3 == len(scene["edges"]) % 4 == len(scene["beacons"]) % 3 == 0
        assert len(scene["frontiers"]) >= 2
        assert {seconds > 0.0 for _, seconds in reader.series["robot/robot/decisions"][0]} == {True}
        reader.until(lambda: reader.series["robot/robot/events"][0][-1][1] == "paused")
        assert "running" in [event[1] for event in reader.series["robot/robot/events"][0]]
        assert of(reader, "watchdog")["mode"]

        # A place that it knows, and where it is not.
        way = reader.series["robot/robot/way"][0]
        goal = max(way, key=lambda place: robot.pose.distance_to(tuple(place)))
        assert reader.command("goal", "robot", x=goal[0], y=goal[1])["state"]["state"] == "paused"
        assert reader.command("resume", "robot")["ok"]
        reader.until(lambda: robot.pose.distance_to(tuple(goal)) < 1.0, 60)
        assert not reader.command("goal", "robot", x="far", y=0.0)["ok"]

        assert reader.command("explore", "robot")["ok"]
        assert list(reader.command("stop")["state"]) == ["robot"]
        reader.until(lambda: of(reader, "status")["emergency_stop"])
        refused = reader.command("start", "robot")
        assert "release it first" in refused["error"]
        assert "a name and the reason" in reader.command("release", "robot")["error"]
        assert reader.command("release", "robot", **OPERATOR)["ok"]
        reader.until(lambda: not of(reader, "status")["emergency_stop"])
        assert "for one robot" in reader.command("pause")["error"]
        assert "no robot 'nobody' answered" in reader.command("pause", "nobody")["error"]


def test_robots_below_a_namespace_come_by_themselves(world):
    _, address, config = world
    ros = config.ros.model_copy(update={"namespace": "second"})
    with Reader(address, channels=["robots", "robot/second/*"]) as reader, Node(ros, "another_bridge") as node:
        status = node.publisher("hd/status", "std_msgs/msg/String")
        told = {"name": "second", "state": "running", "reason": "far away", "pose": [1.0, 2.0, 0.5]}

        def shows():
            status.publish(message("std_msgs/msg/String", data=json.dumps(told)))
            reader.take(0.1)
            return of(reader, "status", "second") == told

        assert eventually(shows, 60)
        assert reader.values["robots"] == [{"name": "robot", "silent": False}, {"name": "second", "silent": False}]
        reader.until(lambda: {"name": "second", "silent": True} in reader.values["robots"])

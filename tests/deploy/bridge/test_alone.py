"""Two bridges of one name: the second does not start, and a stop reaches everybody who answers."""

import contextlib
import os
import threading
from pathlib import Path

import pytest

from common.bus.fleet import bridges_at, command_all
from common.bus.liveness import declare_presence
from common.errors import BusError
from deploy.bridge.bridge import Bridge
from deploy.config import DeployConfig
from deploy.ros2 import Node
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network

MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}


def watchdogs() -> set[int]:
    """The watchdogs that this process has started and that live."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
            if int(parent) == os.getpid() and b"deploy.safety.watchdog" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
    return found


@pytest.mark.timeout(180)
def test_a_second_bridge_of_the_name_does_not_start_and_leaves_the_first_one_alone():
    router, config = network(mapping=MAPPING, decision={"planner": "nearest"})
    stop = threading.Event()
    with FakeRobot(ARMS, router) as robot, Bridge(config) as bridge:
        thread = threading.Thread(target=bridge.run, args=(stop,))
        thread.start()
        try:
            robot.say("start")
            assert eventually(lambda: robot.status.get("state") == "running", 30)
            before = watchdogs()
            with pytest.raises(BusError, match="a bridge with the name 'robot' is already running on this network"):
                Bridge(config)
            assert watchdogs() == before and len(before) == 1, "its watchdog must not have begun"
            assert robot.status["state"] == "running"
            # One that was cut off from the network when it started shows up all the same.
            session = robot.node.session
            with declare_presence(session, "robot", "bridge", "another"):
                assert eventually(lambda: "2 bridges on this network have the name" in robot.status["reason"])
                assert robot.status["state"] == "holding"
                answers = command_all(session, "robot", "stop", 1.5)
                assert {instance for _, instance in answers.missing} == {"another"}
                assert len(answers.states) == 1
            assert eventually(lambda: robot.status["emergency_stop"])
        finally:
            stop.set()
            thread.join()
        with Node(router.model_copy(update={"listen": (), "connect": router.listen}), "operator") as node:
            assert eventually(lambda: len(bridges_at(node.session, "robot")) == 1)


@pytest.mark.parametrize(
    ("namespace", "name"), [("", "robot"), ("robot1", "robot1"), ("/Fleet/Robot_2/", "fleet-robot-2"), ("//", "robot")]
)
def test_a_name_follows_the_namespace(namespace, name):
    config = DeployConfig(ros={"namespace": namespace})
    assert config.name == name
    assert config.named == (name != "robot")
    assert DeployConfig(name="bob", ros={"namespace": namespace}).name == "bob"
    assert DeployConfig.model_validate_json(config.model_dump_json()).name == name

"""The bridge as a lifecycle node: what managers of lifecycles ask of it, over both layouts."""

import pytest

from common.bus.control import request
from deploy.ros2 import message
from tests.common.bus.processes import eventually
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.robots import FakeRobot, network, running_bridge

MAPPING = {"resolution": 0.25, "viewpoint_spacing": 2.0, "sensor_range": 10.0, "beacon_range": 10.0}
IDS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4, "shutdown": 6}


def call(node, name, **fields):
    kind = "lifecycle_msgs/srv/" + "".join(word.capitalize() for word in name.split("_"))
    client = node.client(f"/hd_bridge/{name}", kind)
    return client.call(message(f"{kind}_Request", **fields), 10.0)


def state(node):
    return call(node, "get_state").current_state.label


def change(node, name, by="id"):
    fields = {"id": IDS[name]} if by == "id" else {"label": name}
    return call(node, "change_state", transition=message("lifecycle_msgs/msg/Transition", **fields)).success


@pytest.mark.parametrize("layout", ["rmw_zenoh", pytest.param("ros2dds", marks=pytest.mark.slow)])
def test_a_manager_brings_the_bridge_up_and_down(layout):
    router, config = network(mapping=MAPPING)
    ros = config.ros.model_copy(update={"layout": layout})
    config = config.model_copy(update={"ros": ros})
    router = router.model_copy(update={"layout": layout})
    with FakeRobot(ARMS, router) as robot, running_bridge(config) as (bridge, thread):
        node = robot.node
        assert eventually(lambda: robot.status.get("scans", 0) > 2)
        assert state(node) == "inactive"
        # It is configured already, and whoever configures it once more is told so.
        assert change(node, "configure")
        assert change(node, "activate")
        assert state(node) == "active"
        assert robot.status["state"] != "finished"
        assert not change(node, "cleanup"), "an active node must be deactivated first"
        found = call(node, "get_available_transitions").available_transitions
        assert {(one.transition.id, one.transition.label) for one in found} == {(4, "deactivate"), (7, "shutdown")}
        assert change(node, "deactivate", by="label")
        assert eventually(lambda: robot.status["state"] == "paused")
        assert change(node, "activate")
        assert eventually(lambda: robot.status["state"] in {"running", "holding"})
        assert change(node, "deactivate")
        assert change(node, "cleanup")
        assert state(node) == "unconfigured"
        assert eventually(lambda: robot.status["state"] == "aborted")
        assert not change(node, "activate"), "it is unconfigured"
        assert change(node, "configure")
        request(node.session, "robot", "stop", 10.0)
        assert not change(node, "activate"), "the emergency stop is latched"
        assert {one.label for one in call(node, "get_available_states").available_states} >= {"unconfigured", "active"}
        assert change(node, "shutdown")
        thread.join(10.0)
        assert not thread.is_alive()
    assert bridge.status()["lifecycle"] == "finalized"


def test_an_operators_start_configures_a_bridge_that_was_cleaned_up_and_tells_diagnostics():
    router, config = network(mapping=MAPPING)
    with FakeRobot(ARMS, router) as robot, running_bridge(config):
        told = robot.node.latest("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        assert eventually(lambda: robot.status.get("scans", 0) > 2)
        assert change(robot.node, "cleanup")
        request(robot.node.session, "robot", "start", 10.0)
        assert eventually(lambda: state(robot.node) == "active")

        def levels():
            newest = told.get()
            return {} if newest is None else {one.name: one.level for one in newest[0].status}

        healthy = {f"hd_bridge: {part}": 0 for part in ("task", "inputs", "planner", "watchdog")}
        assert eventually(lambda: levels() == healthy)
        robot.sensing = False
        assert eventually(lambda: levels().get("hd_bridge: inputs") == levels().get("hd_bridge: watchdog") == 2)

"""What the relay carries is what the bridge speaks and hears, in every profile."""

import pytest

from deploy.bridge.bridge import Bridge
from deploy.profiles import DEPLOY, load_deploy_config
from deploy.ros2 import RosError
from deploy.ros2.graph import read_graph
from deploy.ros2.session import open_session
from deploy.routes import Direction, routes_of
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import rmw_router

# The bridge and its watchdog tell each other this one.
BETWEEN_THEM = {"/hd/watchdog"}


@pytest.mark.parametrize("profile", DEPLOY.preset_names())
def test_every_topic_of_bridge_and_watchdog_has_its_route(profile):
    """Looked at from outside: a topic that somebody adds to the bridge must not be forgotten here."""
    with rmw_router() as endpoint:
        config = load_deploy_config(
            overrides=[f"ros.connect={endpoint}", 'topics.remap={"/hd/status": "/renamed"}'], profile=profile
        )
        routes = {route.topic: route for route in routes_of(config)}
        with Bridge(config), open_session(config.ros) as session:
            nodes = {"/hd_bridge", "/hd_bridge_watchdog"}

            found = []

            def complete():
                # Actions are not relayed: their services need a type that no wheel has.
                found[:] = [
                    one
                    for one in read_graph(session, 0).endpoints
                    if one.node in nodes and "/_action/" not in one.topic
                ]
                return {one.topic for one in found} >= set(routes)

            assert eventually(complete), set(routes) - {one.topic for one in found}
        assert {one.topic for one in found} == set(routes)
        for one in found:
            route = routes[one.topic]
            assert one.kind == route.kind, one
            if one.topic in BETWEEN_THEM or (one.role == "subscription" and route.moves):
                continue
            wanted = Direction.TO_BRIDGE if one.role == "subscription" else Direction.TO_ROBOT
            assert route.direction is wanted, one
            if one.role == "subscription" and one.qos.transient_local:
                # What is latched must reach a bridge that starts later than the relay.
                assert route.qos.transient_local, one
            if one.role == "publisher":
                assert route.qos.reliable == one.qos.reliable, one
                assert route.qos.transient_local == one.qos.transient_local, one


def test_names_stand_below_the_namespace_and_are_remapped():
    config = load_deploy_config(
        overrides=["ros.namespace=robot1", "topics.scan=scan", 'topics.remap={"scan": "/lidar/front"}', "topics.joy="]
    )
    routes = {route.topic: route for route in routes_of(config)}
    assert routes["/lidar/front"].needed
    assert "/joy" not in routes
    assert routes["/cmd_vel"].moves


def test_one_topic_of_two_types_or_ways_is_refused():
    with pytest.raises(RosError, match="/odom would be relayed in both directions"):
        routes_of(load_deploy_config(overrides=["topics.beacon=/odom"]))
    with pytest.raises(RosError, match=r"/runtime has two types, .*Bool and .*Float32"):
        routes_of(load_deploy_config(overrides=["topics.finished=/runtime"]))

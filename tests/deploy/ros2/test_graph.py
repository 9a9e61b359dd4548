import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.ros2 import LATCHED, SENSOR, Node, QoS
from deploy.ros2.graph import SeenEndpoint, SeenNode, graph_from, parse_token, read_graph, watch
from deploy.ros2.keys import NodeId, RmwZenoh, Ros2dds
from deploy.ros2.messages import type_hash
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import KINDS, ros

GRID = "nav_msgs/msg/OccupancyGrid"
segments = st.text("abzAZ_09", max_size=5).map(lambda text: "n" + text)
topics = st.lists(segments, min_size=1, max_size=3).map(lambda parts: "/" + "/".join(parts))
few = settings(max_examples=30)
qualities = st.builds(QoS, st.booleans(), st.booleans(), st.integers(1, 1000))


def look(endpoint, nodes, topics):
    """Return what an onlooker sees once it sees these; on a loaded machine a peer may be heard of after the look."""
    looks = []

    def complete():
        looks.append(watch(ros(endpoint)))
        return [node.name for node in looks[-1].nodes] == nodes and list(looks[-1].topics()) == topics

    assert eventually(complete), looks[-1]
    return looks[-1]


def test_onlookers_see_nodes_and_topics(endpoint):
    with Node(ros(endpoint, namespace="robot1"), "slam") as slam, Node(ros(endpoint), "bridge") as bridge:
        slam.publisher("map", GRID, LATCHED)
        bridge.subscribe("/robot1/map", GRID, lambda *_: None, LATCHED)
        bridge.publisher("/scan", "sensor_msgs/msg/LaserScan", SENSOR)
        seen = look(endpoint, ["/bridge", "/robot1/slam"], ["/robot1/map", "/scan"])
        maps = seen.topics()["/robot1/map"]
        assert [(one.role, one.node) for one in maps] == [("publisher", "/robot1/slam"), ("subscription", "/bridge")]
        assert {one.qos for one in maps} == {LATCHED}
        assert {one.kind for one in maps} == {GRID}
        other = watch(ros(endpoint, domain=9), 0.3)
        assert (other.nodes, other.endpoints, other.elsewhere) == ([], [], [0])


def test_endpoints_disappear_with_their_node(endpoint):
    with Node(ros(endpoint), "onlooker") as onlooker:
        with Node(ros(endpoint), "fleeting") as fleeting:
            chatter = fleeting.publisher("/chatter", "std_msgs/msg/String")
            assert eventually(lambda: "/chatter" in read_graph(onlooker.session, 0).topics())
            chatter.close()
            assert eventually(lambda: "/chatter" not in read_graph(onlooker.session, 0).topics())
        assert eventually(lambda: [node.name for node in read_graph(onlooker.session, 0).nodes] == ["/onlooker"])


def test_bridges_are_seen_too(endpoint):
    with Node(ros(endpoint, layout="ros2dds"), "bridge") as bridge:
        bridge.publisher("/robot1/scan", "sensor_msgs/msg/LaserScan", SENSOR)
        (scan,) = look(endpoint, [], ["/robot1/scan"]).topics()["/robot1/scan"]
        assert scan.kind == "sensor_msgs/msg/LaserScan"
        assert scan.node.startswith("bridge ")
        assert scan.qos == SENSOR


@few
@given(st.sampled_from(["publisher", "subscription"]), topics, st.sampled_from(KINDS), qualities, topics, segments)
def test_tokens_of_rmw_zenoh_round_trip(role, topic, kind, qos, space, name):
    layout = RmwZenoh(0, "jazzy")
    node = NodeId(0, "abc", 0, space, name)
    token = layout.endpoint_token(role, topic, kind, qos, node, 3)
    assert parse_token(token) == SeenEndpoint(role, topic, kind, type_hash(kind), qos, f"{space}/{name}")
    assert parse_token(layout.node_token(node)) == SeenNode(f"{space}/{name}", "abc")


@few
@given(st.sampled_from(["publisher", "subscription"]), topics, st.sampled_from(KINDS), qualities)
@pytest.mark.parametrize("distro", ["humble", "jazzy"])
def test_tokens_of_bridges_round_trip(distro, role, topic, kind, qos):
    token = Ros2dds(distro).endpoint_token(role, topic, kind, qos, NodeId(0, "abc", 0, "/", "x"), 3)
    expected = type_hash(kind) if distro == "jazzy" else ""
    assert parse_token(token) == SeenEndpoint(role, topic, kind, expected, qos, "bridge abc")


@pytest.mark.parametrize(
    "token",
    [
        "@ros2_lv/0/abc/0/1/SS/%/%/node/%service/std_srvs::srv::dds_::Trigger_/RIHS01_0/::,10:,:,:,,",
        "@/abc/@ros2_lv/SS/service/std_srvs§srv§Trigger",
        "@/abc/@ros2_lv",
        "hd/run/live/actor/a",
    ],
)
def test_services_and_strangers_are_left_out(token):
    assert parse_token(token) is None
    assert graph_from([token]).endpoints == []


@few
@given(st.text(max_size=60), st.lists(st.text(max_size=8), max_size=14))
def test_strange_tokens_never_fail(text, parts):
    for token in (text, "@ros2_lv/" + text, "@/x/@ros2_lv/MP/" + text, "/".join(["@ros2_lv", *parts])):
        parse_token(token)
        graph_from([token])


def test_defaults_of_qos_are_filled_in():
    assert parse_token("@ros2_lv/0/a/0/1/MP/%/%/n/%t/x::msg::dds_::Y_/RIHS01_0/::,:,:,:,,").qos == QoS(depth=42)
    assert parse_token("@/a/@ros2_lv/MS/t/x§msg§Y/:::").qos == QoS(depth=1)
    assert parse_token("@ros2_lv/0/a/0/1/MP/%/%/n/%t/x::msg::dds_::Y_/RIHS01_0/nonsense").qos == QoS(depth=42)

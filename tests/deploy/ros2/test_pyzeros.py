"""Against pyzeros, an independent implementation of ROS 2 over Zenoh.

Its attachments need a C compiler and minutes of its time at the first use, so only the slow test makes them; the others
put ours beside its messages.
"""

import asyncio
import json
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import pyzeros
import zenoh
from pyzeros import node as pyzeros_node
from pyzeros import pub as pyzeros_pub
from pyzeros import sub as pyzeros_sub
from pyzeros.qos import DurabilityPolicy, QosProfile, ReliabilityPolicy
from pyzeros.utils import rmw_zenoh_gid, ros_type_to_dds_type
from ros2_pyterfaces.cyclone import all_msgs

from common.geometry import Pose, Scan
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, Node, QoS
from deploy.ros2 import conversions as convert
from deploy.ros2.graph import read_graph
from deploy.ros2.keys import Attachment, NodeId, RmwZenoh
from deploy.ros2.messages import deserialize, message, serialize, type_hash
from deploy.ros2.session import open_session
from tests.common.bus.processes import eventually
from tests.deploy.ros2.network import KINDS, ros

THEIR_TYPES = {kind: getattr(all_msgs, kind.split("/")[-1], None) for kind in KINDS}
SCAN_KIND = "sensor_msgs/msg/LaserScan"
SCAN = Scan(np.linspace(1.0, 5.0, 720, dtype=np.float32), -3.0, 0.0078125, 20.0, 0.125)
QUALITIES = [
    (RELIABLE, QosProfile.default()),
    (SENSOR, QosProfile.sensor_data()),
    (LATCHED, QosProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)),
    (QoS(False, True, 42), QosProfile(depth=42, durability="transient_local", reliability=ReliabilityPolicy(2))),
]


@pytest.fixture
def loop():
    """The event loop that objects of pyzeros look for."""
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    yield loop
    asyncio.set_event_loop(None)
    loop.close()


@pytest.fixture
def theirs(endpoint, loop):
    """A node of pyzeros on a session of its own."""
    with open_session(ros(endpoint)) as session:
        node = pyzeros.Node("their_node", session=session, domain_id=0, namespace="/robot1")
        yield node
        node.token.undeclare()


@pytest.fixture
def ours(endpoint):
    with Node(ros(endpoint, namespace="robot1"), "our_node") as node:
        yield node


@pytest.mark.parametrize("kind", [kind for kind, their in THEIR_TYPES.items() if their is not None])
def test_type_hashes_agree(kind):
    assert type_hash(kind) == THEIR_TYPES[kind].hash_rihs01()
    assert kind == THEIR_TYPES[kind].get_type_name()


@pytest.mark.parametrize(("qos", "profile"), QUALITIES)
@pytest.mark.parametrize("topic", ["/scan", "/robot1/front/scan"])
def test_keys_tokens_and_identities_agree(endpoint, topic, qos, profile):
    layout, dds, hash_ = RmwZenoh(7, "jazzy"), ros_type_to_dds_type(SCAN_KIND), type_hash(SCAN_KIND)
    node = NodeId(7, "abc", 3, "/robot1", "driver")
    assert layout.topic_key(topic, SCAN_KIND) == pyzeros_pub.publisher_keyexpr(topic, dds, hash_, "/robot1", 7)
    with open_session(ros(endpoint)) as session:
        identity = {"session": session, "domain_id": 7, "_node_id": 3, "_zenoh_id": "abc"}
        for role, module in (("publisher", pyzeros_pub), ("subscription", pyzeros_sub)):
            token = layout.endpoint_token(role, topic, SCAN_KIND, qos, node, 5)
            assert token == module.token_keyexpr(
                topic, dds, hash_, profile, "driver", namespace="/robot1", _entity_id=5, **identity
            )
            assert layout.gid(token) == rmw_zenoh_gid(token)
        assert layout.node_token(node) == pyzeros_node.token_keyexpr(
            "driver", namespace="/robot1", _entity_id=3, **identity
        )


def say(publisher: pyzeros.Pub, value, gid: bytes) -> None:
    """What `Pub.publish` does, but for the attachment."""
    publisher.zenoh_pub.put(value.serialize(), attachment=Attachment(0, time.time_ns(), gid).pack())


def test_we_read_what_they_publish(theirs, ours):
    scans, odometry = [], []
    ours.subscribe("scan", SCAN_KIND, lambda scan, how: scans.append((scan, how)), SENSOR)
    ours.subscribe("/odom", "nav_msgs/msg/Odometry", lambda value, _: odometry.append(value))
    their_scans = pyzeros.Pub(all_msgs.LaserScan, "scan", QosProfile.sensor_data(), theirs, scope=None)
    their_odometry = pyzeros.Pub(all_msgs.Odometry, "/odom", None, theirs, scope=None)
    scan = all_msgs.LaserScan(angle_min=-1.5, angle_increment=0.5, range_max=10.0, ranges=[1.0, 2.5, 3.0])
    scan.header.frame_id = "laser"
    where = all_msgs.Odometry(child_frame_id="base_link")
    where.pose.pose.position.x = 4.5
    where.twist.twist.angular.z = 0.25

    def both():
        say(their_scans, scan, their_scans.gid.tobytes())
        say(their_odometry, where, their_odometry.gid.tobytes())
        return scans and odometry

    assert eventually(both)
    got, how = scans[-1]
    assert got.header.frame_id == "laser"
    assert convert.scan_from(got).ranges.tolist() == [1.0, 2.5, 3.0]
    assert how.publisher == their_scans.gid.tobytes()
    assert how.sequence == 0
    _, pose, velocity = convert.pose_from(odometry[-1])
    assert (pose.x, velocity) == (4.5, (0.0, 0.25))
    their_scans.undeclare()
    their_odometry.undeclare()


@pytest.mark.parametrize("qos", [SENSOR, LATCHED], ids=["sensor", "latched"])
def test_they_read_what_we_publish(loop, theirs, ours, qos):
    async def listen():
        sub = pyzeros.Sub(all_msgs.LaserScan, "scan", QosProfile.sensor_data(), theirs, scope=None)
        scans = ours.publisher("scan", SCAN_KIND, qos)
        try:
            for _ in range(200):
                scans.publish(convert.laser_scan(12.5, "laser", SCAN))
                try:
                    return await asyncio.wait_for(sub.wait_for_value(), 0.1)
                except TimeoutError:
                    continue
        finally:
            sub.close()

    got = loop.run_until_complete(listen())
    assert got is not None
    assert np.array_equal(np.asarray(got.ranges, np.float32), SCAN.ranges)
    assert (got.header.stamp.sec, got.header.stamp.nanosec) == (12, 500_000_000)
    assert got.header.frame_id == "laser"


def test_their_subscription_gets_our_encoding_and_attachment(theirs, ours):
    samples: list[zenoh.Sample] = []
    raw = pyzeros_sub.RawSub(all_msgs.Twist, "cmd_vel", samples.append, None, theirs, scope=None)
    velocity = ours.publisher("cmd_vel", "geometry_msgs/msg/Twist")

    def arrived():
        velocity.publish(convert.twist(0.5, 0.1))
        return samples

    assert eventually(arrived)
    raw.undeclare()
    sample = samples[-1]
    assert Attachment.unpack(sample.attachment.to_bytes()).sequence >= 1
    assert str(sample.encoding) == "application/cdr"
    assert all_msgs.Twist.deserialize(sample.payload.to_bytes()).linear.x == 0.5


PUBLISH = """
import json, sys, time
import pyzeros, zenoh
from pyzeros.builtin_msgs import Attachment
from ros2_pyterfaces.cyclone import all_msgs
settings = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
    node = pyzeros.Node("their_node", session=session, domain_id=0)
    pub = pyzeros.Pub(all_msgs.String, "/chatter", None, node, scope=None)
    pub.publish(all_msgs.String(data="compiled"))
    print(json.dumps({"gid": pub.gid.tobytes().hex()}), flush=True)
    for _ in range(300):
        pub.publish(all_msgs.String(data="hello"))
        time.sleep(0.05)
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(shutil.which("gcc") is None, reason="pyzeros compiles its attachments with a C compiler")
def test_we_read_their_attachments(endpoint, ours):
    got = []
    ours.subscribe("/chatter", "std_msgs/msg/String", lambda value, how: got.append((value.data, how)))
    command = [sys.executable, "-c", PUBLISH, endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            gid = json.loads(process.stdout.readline())["gid"]
            assert eventually(lambda: len(got) >= 3)
        finally:
            process.kill()
    words, how = got[-1]
    assert words == "hello"
    assert how.publisher.hex() == gid
    assert [one.sequence for _, one in got] == list(range(got[0][1].sequence, got[0][1].sequence + len(got)))
    assert abs(how.source_time - time.time_ns()) < 60e9


def test_we_see_their_node_and_topics(theirs, ours):
    pub = pyzeros.Pub(all_msgs.LaserScan, "lidar", QosProfile.sensor_data(), theirs, scope=None)
    sub = pyzeros_sub.RawSub(all_msgs.Twist, "/cmd_vel", lambda _: None, None, theirs, scope=None)

    def seen():
        graph = read_graph(ours.session, 0)
        topics = graph.topics()
        return (
            "/robot1/their_node" in [node.name for node in graph.nodes]
            and [(one.role, one.kind, one.qos) for one in topics.get("/robot1/lidar", [])]
            == [("publisher", SCAN_KIND, SENSOR)]
            and [one.role for one in topics.get("/cmd_vel", [])] == ["subscription"]
        )

    assert eventually(seen)
    pub.undeclare()
    sub.undeclare()


def test_they_would_see_our_tokens(theirs, ours):
    """pyzeros lists no graph; the tokens on the network must be those that its functions compute for such a node."""
    ours.publisher("scan", SCAN_KIND, SENSOR)
    zid = str(ours.session.zid())
    expected = pyzeros_pub.token_keyexpr(
        "scan",
        ros_type_to_dds_type(SCAN_KIND),
        all_msgs.LaserScan.hash_rihs01(),
        QosProfile.sensor_data(),
        "our_node",
        theirs.session,
        0,
        "/robot1",
        _node_id=0,
        _zenoh_id=zid,
        _entity_id=1,
    )

    def tokens():
        return {str(r.ok.key_expr) for r in theirs.session.liveliness().get("@ros2_lv/0/**", timeout=2.0) if r.ok}

    assert eventually(lambda: expected in tokens())


@pytest.mark.parametrize("kind", [kind for kind, their in THEIR_TYPES.items() if their is not None])
def test_both_codecs_write_the_same_bytes(kind):
    """An empty message of every type; padding at the end may differ."""
    ours = serialize(message(kind), kind)
    their = bytes(THEIR_TYPES[kind]().serialize())
    assert their[: len(ours)].rstrip(b"\0") in (ours.rstrip(b"\0"), _without_rotation(ours).rstrip(b"\0"))
    assert deserialize(their[: len(ours)], kind) is not None


def _without_rotation(payload: bytes) -> bytes:
    # Their quaternions may start at zero.
    return payload.replace(np.float64(1.0).tobytes(), bytes(8))


def test_odometry_of_both_codecs_agrees():
    ours = convert.odometry(3.5, "map", "base_link", Pose(1.0, 2.0, 0.0), (0.5, 0.25))
    their = all_msgs.Odometry.deserialize(serialize(ours, "nav_msgs/msg/Odometry"))
    assert their.child_frame_id == "base_link"
    assert their.pose.pose.position.y == 2.0
    assert their.pose.pose.orientation.w == 1.0
    assert their.twist.twist.linear.x == 0.5
    back = deserialize(bytes(their.serialize()), "nav_msgs/msg/Odometry")
    assert convert.pose_from(back) == convert.pose_from(ours)

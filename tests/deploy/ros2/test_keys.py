import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.ros2.keys import Attachment, NodeId, RmwZenoh, Ros2dds, dds_type, ros_type
from deploy.ros2.messages import type_hash
from deploy.ros2.qos import LATCHED, RELIABLE, SENSOR, QoS
from tests.deploy.ros2.network import KINDS

SCAN = "sensor_msgs/msg/LaserScan"
SCAN_HASH = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
NODE = NodeId(0, "abc", 0, "/", "hd_bridge")


def test_rmw_zenoh_keys():
    layout = RmwZenoh(0, "jazzy")
    assert layout.topic_key("/robot1/scan", SCAN) == f"0/robot1/scan/sensor_msgs::msg::dds_::LaserScan_/{SCAN_HASH}"
    assert layout.node_token(NODE) == "@ros2_lv/0/abc/0/0/NN/%/%/hd_bridge"
    assert layout.endpoint_token("publisher", "/robot1/scan", SCAN, RELIABLE, NODE, 7) == (
        f"@ros2_lv/0/abc/0/7/MP/%/%/hd_bridge/%robot1%scan/sensor_msgs::msg::dds_::LaserScan_/{SCAN_HASH}/::,10:,:,:,,"
    )


def test_humble_has_no_type_hashes():
    assert RmwZenoh(3, "humble").topic_key("/scan", SCAN) == (
        "3/scan/sensor_msgs::msg::dds_::LaserScan_/TypeHashNotSupported"
    )
    assert Ros2dds("humble").endpoint_token("subscription", "/scan", SCAN, RELIABLE, NODE, 1) == (
        "@/abc/@ros2_lv/MS/scan/sensor_msgs§msg§LaserScan/:1:0:0,10"
    )


def test_bridge_keys():
    layout = Ros2dds("jazzy")
    assert layout.topic_key("/bot1/cmd_vel", "geometry_msgs/msg/Twist") == "bot1/cmd_vel"
    assert layout.node_token(NODE) is None
    assert layout.endpoint_token("publisher", "/bot1/scan", SCAN, LATCHED, NODE, 1) == (
        f"@/abc/@ros2_lv/MP/bot1§scan/sensor_msgs§msg§LaserScan/:1:1:0,1:typehash={SCAN_HASH};"
    )


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (RELIABLE, "::,10:,:,:,,"),
        (SENSOR, "2::,5:,:,:,,"),
        (LATCHED, ":1:,1:,:,:,,"),
        (QoS(depth=42), "::,:,:,:,,"),
    ],
)
def test_qos_in_tokens(qos, text):
    token = RmwZenoh(0, "jazzy").endpoint_token("subscription", "/scan", SCAN, qos, NODE, 1)
    assert token.endswith("/" + text)


def test_depth_must_hold_something():
    with pytest.raises(ValueError, match="at least 1"):
        QoS(depth=0)


@given(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_attachments_round_trip(sequence, time, gid):
    attachment = Attachment(sequence, time, gid)
    assert len(attachment.pack()) == 33
    assert Attachment.unpack(attachment.pack()) == attachment


@given(st.binary(max_size=80).filter(lambda data: len(data) != 33 or data[16] != 16))
def test_other_attachments_are_none(data):
    assert Attachment.unpack(data) is None


@pytest.mark.parametrize("kind", KINDS)
def test_type_names_round_trip(kind):
    assert ros_type(dds_type(kind)) == kind
    assert type_hash(kind) == type_hash(kind, "kilted")
    assert type_hash(kind).startswith("RIHS01_")

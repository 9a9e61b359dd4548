"""What the watchdog takes as news of the robot's pose."""

import pytest

from common.geometry import Pose
from deploy.profiles import load_deploy_config
from deploy.ros2 import Received
from deploy.ros2.conversions import transform, transform_message
from deploy.safety.inputs import WatchdogInputs
from deploy.safety.rules import GateRules


def heard(fixed, moved):
    """Whether a message of /tf counts, after static transforms from parents to children."""
    config = load_deploy_config(None, ["sensing.pose=tf"], {}, "bare")
    rules = GateRules(config.safety, "scan", 0.0, drives=True)
    inputs = WatchdogInputs(config, rules, "1", lambda: None, lambda: None)
    received = Received(5.0, 0, 0)
    for frames, take in ((fixed, inputs._heard_static_transforms), (moved, inputs._heard_transforms)):
        take(transform_message([transform(1.0, parent, child, Pose(0.0, 0.0)) for parent, child in frames]), received)
    return rules.pose_time == 5.0


FOOTPRINT = [("base_footprint", "/base_link"), ("base_link", "laser")]


@pytest.mark.parametrize(
    ("fixed", "moved", "counts"),
    [
        ([], [("odom", "base_link")], True),
        ([], [("map", "odom")], False),
        ([], [("odom", "base_footprint")], False),
        (FOOTPRINT, [("/odom", "/base_footprint")], True),
        (FOOTPRINT, [("map", "odom")], False),
        (FOOTPRINT, [("base_link", "wheel")], False),
        ([("a", "base_link"), ("base_link", "a")], [("map", "odom")], False),
    ],
)
def test_only_what_moves_the_base_is_news_of_its_pose(fixed, moved, counts):
    assert heard(fixed, moved) == counts

"""Poses that no motion explains."""

import pytest

from common.geometry import Pose
from deploy.tf.leaps import PoseLeaps


@pytest.mark.parametrize(
    ("stamp", "pose", "why"),
    [
        (10.1, Pose(2.1, 2.0, 0.1), ""),
        (10.1, Pose(3.15, 2.0), ""),
        (10.1, Pose(3.5, 2.0), "jumped 1.50 m in 0.10 s"),
        (10.1, Pose(2.0, 2.0, 1.57), "turned 1.57 rad in 0.10 s"),
        (12.0, Pose(2.0, 2.0), "no pose came for 2.0 s"),
        (5.0, Pose(2.0, 2.0), ""),
        (5.0, Pose(0.0, 0.0), "jumped 2.83 m in 0.00 s"),
    ],
)
def test_a_leap_is_told(stamp, pose, why):
    leaps = PoseLeaps(jump=1.0, speed=2.0, turn_rate=3.0, timeout=1.0)
    assert leaps.take(10.0, Pose(2.0, 2.0)) == ""
    told = leaps.take(stamp, pose)
    assert why in told
    assert bool(told) == bool(why)

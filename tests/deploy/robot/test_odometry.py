import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.robot.odometry import Odometry, compose, correction, relative

poses = st.builds(Pose, st.floats(-100, 100), st.floats(-100, 100), st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_compose_undoes_relative(base, other):
    again = compose(base, relative(base, other))
    assert again.distance_to(other.position) < 1e-9
    assert abs(math.remainder(again.yaw - other.yaw, 2.0 * math.pi)) < 1e-9


@given(poses, poses)
def test_the_correction_puts_the_odometry_where_the_robot_is(truth, odometry):
    x, y, yaw = correction(truth, odometry)
    again = compose(Pose(x, y, yaw), (odometry.x, odometry.y, odometry.yaw))
    assert again.distance_to(truth.position) < 1e-9
    assert abs(math.remainder(again.yaw - truth.yaw, 2.0 * math.pi)) < 1e-9


def circle(count=2000):
    return [Pose(10.0 * math.cos(a), 10.0 * math.sin(a), a) for a in np.linspace(0.0, 2.0 * math.pi, count)]


def test_without_drift_the_odometry_is_the_truth():
    way = circle()
    odometry = Odometry(way[0], 0.0, seed=1)
    assert [odometry.update(pose) for pose in way] == way


@pytest.mark.parametrize("seed", range(3))
def test_drift_grows_with_the_way_and_not_while_standing(seed):
    way = circle()
    odometry = Odometry(way[0], 0.02, seed)
    ends = [odometry.update(pose) for pose in way]
    error = ends[-1].distance_to(way[-1].position)
    assert 0.02 < error < 10.0
    for _ in range(100):
        still = odometry.update(way[-1])
    assert still.distance_to(ends[-1].position) < 1e-9

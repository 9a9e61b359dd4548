"""Point clouds as beams in the plane."""

import numpy as np
import pytest

from common.errors import MappingError
from common.geometry import Pose
from deploy.config import DrivingConfig, SensingConfig
from deploy.mapping.cloud import checked_points, project
from deploy.mapping.log_odds import Beams
from deploy.mapping.own_body import OwnBody
from deploy.tf.transform import Transform
from tests.deploy.mapping.lidar import cloud_at, room, scan_at

SENSING = SensingConfig(beams=360)
BODY = OwnBody(DrivingConfig())


def beams_of(*points: tuple[float, float, float], floor: float = 0.0) -> Beams:
    """Beams of points in the map frame from a lidar 0.4 m above the floor at (1, 2)."""
    cloud = np.array(points, dtype=np.float32)
    return project(cloud, Transform(), (1.0, 2.0, floor + 0.4), floor, SENSING, 20.0, BODY, Pose(1.0, 2.0))


def along_x(beams: Beams) -> tuple[float, bool]:
    return float(beams.ranges[180]), bool(beams.hits[180])


def test_the_nearest_point_of_the_band_is_the_obstacle():
    assert along_x(beams_of((6.0, 2.01, 0.3), (4.0, 2.01, 1.2), (9.0, 2.01, 0.0))) == (
        pytest.approx(3.0, abs=1e-3),
        True,
    )


def test_a_floor_seen_behind_a_low_obstacle_does_not_free_it():
    assert along_x(beams_of((9.0, 2.01, 0.0), (4.0, 2.01, 0.2))) == (pytest.approx(3.0, abs=1e-3), True)


def test_a_beam_that_sees_only_floor_is_free_up_to_the_farthest_of_it():
    assert along_x(beams_of((3.0, 2.01, 0.02), (5.0, 2.01, 0.1))) == (pytest.approx(4.0, abs=1e-3), False)


def test_a_drop_is_not_free_beyond_its_edge():
    # The line of sight from 0.4 m goes through the floor's level halfway to a point 0.4 m below it.
    assert along_x(beams_of((5.0, 2.01, -0.4))) == (pytest.approx(2.0, abs=1e-3), False)


def test_the_ceiling_and_an_empty_direction_tell_nothing():
    beams = beams_of((5.0, 2.01, 2.5))
    assert np.isnan(beams.ranges).all()
    assert not beams.hits.any()


def test_far_and_near_points():
    assert along_x(beams_of((40.0, 2.01, 0.5))) == (20.0, False), "beyond the range: free up to it"
    assert np.isnan(beams_of((1.1, 2.0, 0.3)).ranges).all(), "the robot itself"
    assert np.isnan(beams_of((np.nan, 2.0, 0.3), (np.inf, 2.0, 0.3)).ranges).all(), "no returns"


def test_heights_count_from_the_floor_below_the_robot():
    assert along_x(beams_of((4.0, 2.01, 10.3), floor=10.0)) == (pytest.approx(3.0, abs=1e-3), True)
    assert along_x(beams_of((4.0, 2.01, 10.05), floor=10.0)) == (pytest.approx(3.0, abs=1e-3), False)


def test_clouds_in_the_frame_of_a_tilted_sensor_are_put_upright():
    pose = Pose(5.0, 5.0)
    cloud = cloud_at(room(), pose, frame="sensor")
    tilt = Transform((5.0, 5.0, 0.4), (0.0, float(np.sin(0.1)), 0.0, float(np.cos(0.1))))
    as_seen = (cloud - 0.0) @ tilt.matrix()
    straight = project(cloud, Transform((5.0, 5.0, 0.4)), (5.0, 5.0, 0.4), 0.0, SENSING, 20.0, BODY, pose)
    tilted = project(as_seen.astype(np.float32), tilt, (5.0, 5.0, 0.4), 0.0, SENSING, 20.0, BODY, pose)
    same = np.isclose(straight.ranges, tilted.ranges, atol=1e-3, equal_nan=True)
    assert same.mean() > 0.98


def test_a_lidar_of_sixteen_lines_sees_the_walls_that_a_planar_one_sees():
    pose = Pose(5.0, 5.0)
    beams = project(cloud_at(room(), pose, azimuths=1800), Transform(), (5.0, 5.0, 0.4), 0.0, SENSING, 12.0, BODY, pose)
    scan = scan_at(room(), Pose(5.0, 5.0, np.pi / 360), beams=360)
    assert beams.hits.mean() > 0.9
    both = beams.hits & (scan.ranges < 12.0)
    assert np.median(np.abs(beams.ranges[both] - scan.ranges[both])) < 0.05


def test_what_is_no_cloud_is_refused():
    with pytest.raises(MappingError, match="shape"):
        checked_points(np.zeros((4, 2), dtype=np.float32))
    theirs = np.zeros((4, 5), dtype=np.float64)
    theirs.flags.writeable = False
    ours = checked_points(theirs)
    assert (ours.dtype, ours.shape, ours.flags.writeable) == (np.float32, (4, 3), True)

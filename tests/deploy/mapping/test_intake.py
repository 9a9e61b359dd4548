"""Sensor messages that wait for the pose of their moment."""

import numpy as np
import pytest

from common.geometry import Pose, Scan
from deploy.mapping.intake import MAX_READY, MAX_WAITING, Intake
from tests.deploy.mapping.lidar import cloud_at, configure, room, scan_at

SCAN = Scan(np.array([3.0], dtype=np.float32), 0.0, 0.1, 12.0)
HALF_TURN = (1.0, 0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def make_intake(**sections) -> Intake:
    config = configure(**sections)
    return Intake(config.frames, config.sensing, config.mapping.sensor_range, config.driving)


def drive(intake: Intake, start: float, end: float) -> None:
    """Poses at 20 Hz of a robot that drives along x at 1 m/s."""
    for k in range(round(start * 20), round(end * 20) + 1):
        intake.add_pose(k / 20, Pose(k / 20, 0.0), 0.0)


def test_a_scan_waits_for_the_poses_around_it():
    intake = make_intake()
    drive(intake, 0.0, 1.0)
    intake.add_scan(1.03, SCAN, "")
    intake.resolve()
    assert intake.waiting == 1
    drive(intake, 1.05, 1.05)
    intake.resolve()
    (_, sensor) = intake.ready[0]
    assert sensor.x == pytest.approx(1.03)
    assert intake.obstacles()[0] == pytest.approx([4.03, 0.0])


def test_a_scan_waits_for_poses_that_come_slowly():
    intake = make_intake()
    intake.add_pose(1.0, Pose(1.0, 0.0), 0.0)
    for stamp in (1.05, 1.15, 1.25, 1.35):
        intake.add_scan(stamp, SCAN, "")
        intake.resolve()
    assert intake.waiting == 4
    intake.add_pose(1.35, Pose(1.35, 0.0), 0.0)
    intake.resolve()
    assert [sensor.x for _, sensor in intake.ready] == pytest.approx([1.05, 1.15, 1.25, 1.35])


def test_a_correction_that_is_stamped_ahead_hurries_no_scan():
    # As AMCL and Cartographer stamp map -> odom, and with odometry that comes a little later than scans.
    intake = make_intake(sensing={"pose": "tf"})
    for stamp in (0.9, 1.0):
        intake.add_transforms([(stamp + 1.0, "map", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))], static=False)
        intake.add_transforms([(stamp, "odom", "base_link", (stamp, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))], static=False)
    intake.add_scan(1.05, SCAN, "")
    intake.resolve()
    assert intake.waiting == 1
    intake.add_transforms([(1.1, "odom", "base_link", (1.1, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))], static=False)
    intake.resolve()
    (_, sensor) = intake.ready[0]
    assert sensor.x == pytest.approx(1.05)


@pytest.mark.parametrize("ahead", [0.0, 30.0])
def test_a_link_that_is_too_old_or_far_ahead_is_named(ahead):
    intake = make_intake(sensing={"pose": "tf"})
    intake.add_transforms([(1.0 + ahead, "map", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))], static=False)
    for stamp in (7.0, 7.1, 7.2):
        intake.add_transforms([(stamp, "odom", "base_link", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))], static=False)
        intake.add_scan(stamp, SCAN, "")
        intake.resolve()
    assert intake.messages.dropped["no pose"] == 3
    assert f"map -> odom is stamped {1.0 + ahead:.3f} s" in intake.messages.problem
    assert "/tf_static" in intake.messages.problem


def test_a_scan_without_a_pose_is_dropped_and_says_why():
    intake = make_intake()
    drive(intake, 0.0, 1.0)
    for k in range(5):
        intake.add_scan(5.0 + k * 0.15, SCAN, "")
        intake.resolve()
    assert intake.messages.dropped["no pose"] == 3
    assert intake.waiting == 2
    assert "same clock" in intake.messages.problem
    assert not intake.ready


def test_poses_that_end_a_moment_before_the_scan_are_good_enough():
    intake = make_intake()
    drive(intake, 0.0, 1.0)
    intake.add_scan(1.1, SCAN, "")
    intake.add_scan(1.4, SCAN, "")
    intake.resolve()
    assert len(intake.ready) == 1
    assert intake.ready[0][1].x == 1.0


def test_queues_are_bounded():
    intake = make_intake()
    for k in range(3 * MAX_WAITING):
        intake.add_scan(k / 1000, SCAN, "")
    assert intake.waiting == MAX_WAITING
    assert intake.messages.dropped["queue full"] == 2 * MAX_WAITING
    intake = make_intake()
    for k in range(3 * MAX_READY):
        drive(intake, k / 20, k / 20)
        intake.add_scan(k / 20, SCAN, "")
        intake.resolve()
    assert len(intake.ready) == MAX_READY
    assert intake.messages.dropped["map not refreshed"] == 2 * MAX_READY


def test_a_recording_played_again_goes_on():
    intake = make_intake()
    for _ in range(2):
        drive(intake, 100.0, 101.0)
        intake.add_scan(100.5, SCAN, "")
        intake.resolve()
    drive(intake, 2.0, 3.0)
    intake.add_scan(2.5, SCAN, "")
    intake.resolve()
    assert [round(sensor.x, 2) for _, sensor in intake.ready] == [100.5, 100.5, 2.5]
    assert intake.obstacles()[0, 0] == pytest.approx(5.5)


@pytest.mark.parametrize("back", [0.2, 1.0, 5.0, 10.0])
def test_a_clock_set_back_places_no_scan_where_the_robot_was(back):
    intake, x = make_intake(), 0.0
    for k in range(200):
        time = 100.0 + k / 20 - (back if k >= 100 else 0.0)
        x = k / 20
        intake.add_pose(time, Pose(x, 0.0), 0.0)
        if k % 2 == 0:
            intake.add_scan(time, SCAN, "")
        intake.resolve()
        if intake.ready:
            assert intake.ready.pop()[1].x == pytest.approx(x, abs=0.06)
    assert intake.pose.x == x
    assert "set back" in intake.messages.problem


def test_a_scan_that_comes_again_is_no_evidence():
    intake = make_intake()
    drive(intake, 0.0, 1.0)
    for _ in range(5):
        intake.add_scan(0.5, SCAN, "")
        intake.resolve()
    assert len(intake.ready) == 1
    assert intake.messages.dropped["scan outdated"] == 4


def test_the_sensors_place_on_the_base_by_configuration_and_by_tf():
    intake = make_intake(sensing={"sensor_offset": (0.5, 0.2, np.pi / 2)})
    drive(intake, 0.0, 1.0)
    intake.add_scan(0.5, SCAN, "lidar")
    intake.resolve()
    assert intake.waiting == 1, "its frame may still come on /tf_static"
    drive(intake, 1.0, 3.0)
    intake.resolve()
    assert intake.obstacles()[0] == pytest.approx([1.0, 3.2])
    intake.add_transforms([(0.0, "base_link", "lidar", (-0.5, 0.0, 0.4), UPRIGHT)], True)
    intake.add_scan(3.0, SCAN, "lidar")
    intake.resolve()
    assert intake.obstacles()[0] == pytest.approx([5.5, 0.0])


def test_frames_without_end_are_not_remembered():
    intake = make_intake()
    drive(intake, 0.0, 1.0)
    for number in range(1500):
        intake.add_scan(0.5, SCAN, f"frame {number}")
    assert intake.messages.dropped["too many frames"] > 0
    assert intake.waiting <= MAX_WAITING


def test_a_lidar_that_hangs_upside_down_sees_left_and_right_exchanged():
    intake = make_intake()
    intake.add_transforms([(0.0, "base_link", "lidar", (0.0, 0.0, 0.4), HALF_TURN)], True)
    drive(intake, 0.0, 1.0)
    intake.add_scan(0.5, Scan(np.array([2.0], dtype=np.float32), np.pi / 2, 0.1, 12.0), "lidar")
    intake.resolve()
    assert intake.obstacles()[0] == pytest.approx([0.5, -2.0])


def tf_intake(**sensing: object) -> Intake:
    intake = make_intake(sensing={"pose": "tf", **sensing})
    intake.add_transforms([(0.0, "map", "odom", (10.0, 0.0, 0.0), UPRIGHT)], False)
    for k in range(21):
        intake.add_transforms([(k / 20, "odom", "base_link", (k / 20, 0.0, 0.1), UPRIGHT)], False)
    return intake


def test_poses_by_tf():
    intake = tf_intake()
    assert intake.pose == Pose(11.0, 0.0, 0.0)
    intake.add_pose(5.0, Pose(99.0, 0.0), 0.0)
    assert intake.pose.x == 11.0, "odometry does not count then"
    intake.add_scan(0.525, SCAN, "")
    intake.resolve()
    assert intake.obstacles()[0] == pytest.approx([13.525, 0.0])


def test_a_scan_waits_a_moment_for_its_frame_on_tf_static():
    intake = tf_intake()
    intake.add_scan(0.5, SCAN, "lidar")
    intake.resolve()
    assert intake.waiting == 1
    intake.add_transforms([(0.0, "base_link", "lidar", (0.5, 0.0, 0.4), UPRIGHT)], True)
    intake.resolve()
    assert intake.obstacles()[0] == pytest.approx([14.0, 0.0])


def test_a_frame_that_never_comes_delays_the_first_seconds_alone():
    intake = tf_intake(sensor_offset=(0.5, 0.0, 0.0))
    for k in range(100):
        stamp = 1.0 + k / 20
        intake.add_transforms([(stamp, "map", "odom", (10.0, 0.0, 0.0), UPRIGHT)], False)
        intake.add_transforms([(stamp, "odom", "base_link", (1.0, 0.0, 0.1), UPRIGHT)], False)
        if k % 2 == 0:
            intake.add_scan(stamp, SCAN, "lidar")
            intake.resolve()
            if stamp <= 2.95:
                assert not intake.ready
    assert intake.waiting == 0
    assert intake.obstacles()[0] == pytest.approx([14.5, 0.0])
    assert intake.messages.dropped == {}


@pytest.mark.parametrize("frame", ["map", "sensor"])
def test_clouds_stand_where_the_walls_are(frame):
    free, pose = room(), Pose(5.0, 5.0, 0.7)
    intake = make_intake(sensing={"source": "points", "points_frame": frame})
    intake.add_pose(1.0, pose, 0.0)
    intake.add_points(1.0, cloud_at(free, pose, frame=frame), "")
    obstacles = intake.obstacles()
    assert len(obstacles) > 300
    # Each lies on the face of a wall: a step outwards from the robot is not free.
    out = obstacles + 0.05 * (obstacles - [pose.x, pose.y]) / np.hypot(*(obstacles - [pose.x, pose.y]).T)[:, None]
    cells = np.floor(out / 0.25).astype(int)
    assert (~free[cells[:, 1], cells[:, 0]]).mean() > 0.97
    assert intake.volume.value > 10.0


def test_heights_count_from_below_the_lidar_where_tf_places_it():
    """A robot on an upper storey, 3 m above the map's zero; the lidar 0.6 m above its base frame."""
    free, pose = room(), Pose(5.0, 5.0)
    intake = make_intake(sensing={"pose": "tf", "source": "points", "points_frame": "sensor"})
    intake.add_transforms([(0.0, "base_link", "lidar", (0.0, 0.0, 0.3), UPRIGHT)], True)
    intake.add_transforms([(1.0, "map", "base_link", (5.0, 5.0, 3.1), UPRIGHT)], False)
    intake.add_points(1.0, cloud_at(free, pose, frame="sensor"), "lidar")
    assert len(intake.obstacles()) > 300
    assert intake.cloud.floor == pytest.approx(3.0)


def test_what_is_not_the_source_of_the_map_still_shows_obstacles():
    intake = make_intake(sensing={"source": "grid"})
    intake.add_pose(1.0, Pose(4.0, 5.0), 0.0)
    intake.add_scan(1.0, scan_at(room(), Pose(4.0, 5.0)), "")
    assert len(intake.obstacles()) > 300
    assert not intake.ready


def test_messages_that_are_none_are_counted():
    intake = make_intake()
    intake.add_pose(1.0, Pose(float("nan"), 0.0), 0.0)
    intake.add_scan(float("nan"), SCAN, "")
    intake.add_scan(1.0, Scan(SCAN.ranges, 0.0, 0.1, 0.0), "")
    intake.add_points(1.0, np.zeros((3, 2), dtype=np.float32), "")
    intake.add_transforms([(1.0, "map", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))], False)
    assert sum(intake.messages.dropped.values()) == 5
    assert intake.obstacles() is None

"""Every header's frame is transformed, or refused by name."""

from math import pi

import numpy as np
import pytest

from common.geometry import Pose
from deploy.bridge.inputs import Inputs
from deploy.config import DeployConfig
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from deploy.ros2 import Received, RosError, message
from deploy.ros2 import conversions as ros
from deploy.safety.health import HealthMonitor
from tests.deploy.mapping.lidar import RESOLUTION, cloud_at, room, scan_at

# The robot drives along y = 6 from x = 4 to at most 7.
FREE = room()
PERIOD = 0.1
LIDAR = (0.5, 0.0, pi / 2)


class Robot:
    """A bridge's inputs and map, fed with messages as a robot sends them."""

    def __init__(self, *overrides: str, profile: str = "bare") -> None:
        self.config: DeployConfig = load_deploy_config(None, overrides, {}, profile)
        self.map = RobotMap(self.config)
        self.inputs = Inputs(self.config, self.map, HealthMonitor(self.config.safety))
        self.told: list[str] = []
        self.time = 0.0

    def take(self, name: str, sent: object) -> None:
        try:
            getattr(self.inputs, f"take_{name}")(sent, Received(self.time, round(self.time * 1e9), 0))
        except RosError as error:
            self.told.append(str(error))
        self.map.refresh()
        self.told.append(self.map.statistics.problem)

    def tf(self, parent: str, child: str, pose: Pose, *, static: bool = True) -> None:
        sent = ros.transform_message([ros.transform(self.time, parent, child, pose)])
        self.take("static_transforms" if static else "transforms", sent)

    def walls_are_right(self) -> bool:
        """Whether what is occupied lies at walls of the room."""
        found = self.map.occupancy()
        if found is None:
            return False
        states, resolution, origin = found
        places = (np.argwhere(states == 100)[:, ::-1] + 0.5) * resolution + np.array(origin)
        if len(places) < 50:
            return False
        cells = np.floor(places / RESOLUTION).astype(int)
        padded = np.pad(FREE, 3, constant_values=False)
        near = [not padded[r + 2 : r + 5, c + 2 : c + 5].all() for c, r in cells]
        return float(np.mean(near)) > 0.95


def base(step: int) -> Pose:
    return Pose(4.0 + 0.05 * step, 6.0, 0.02 * step)


def composed(pose: Pose, by: tuple[float, float, float]) -> Pose:
    cosine, sine = np.cos(pose.yaw), np.sin(pose.yaw)
    return Pose(pose.x + cosine * by[0] - sine * by[1], pose.y + sine * by[0] + cosine * by[1], pose.yaw + by[2])


def drive(robot: Robot, frame: str, *, steps: int = 40, odometry: str = "map", tf_at: int = -1, mount=LIDAR) -> None:
    """Send odometry and scans of a lidar at `mount`; its static transform comes at a step, -1 for never."""
    for step in range(steps):
        robot.time = 1.0 + PERIOD * step
        if step == tf_at:
            robot.tf("base_link", frame, Pose(*mount))
        robot.take("odometry", ros.odometry(robot.time, odometry, "base_link", base(step)))
        scan = scan_at(FREE, composed(base(step), mount))
        robot.take("scan", ros.laser_scan(robot.time, frame, scan))


@pytest.mark.parametrize("tf_at", [0, 7, 15])
def test_scans_wait_for_static_transforms_that_come_later(tf_at):
    robot = Robot()
    drive(robot, "laser", tf_at=tf_at)
    assert robot.walls_are_right()
    assert robot.map.statistics.dropped == {}
    assert not any(robot.told)


def test_a_transform_that_comes_late_where_the_robot_has_others_spoils_nothing():
    robot = Robot()
    robot.tf("base_link", "camera", Pose(0.1, 0.0))
    drive(robot, "laser", steps=60, tf_at=40)
    assert robot.walls_are_right()
    assert set(robot.map.statistics.dropped) == {"frame not known"}
    assert any("'laser'" in told and "/tf_static" in told for told in robot.told)


def test_a_robot_without_tf_is_told_what_its_lidar_is_taken_for():
    robot = Robot()
    drive(robot, "/laser", mount=(0.0, 0.0, 0.0))
    assert robot.walls_are_right()
    assert any("'laser'" in told and "sensing.sensor_offset" in told for told in robot.told)
    quiet = Robot("sensing.sensor_offset=0.5,0,1.5707963")
    drive(quiet, "laser")
    assert quiet.walls_are_right() and not any(quiet.told)


def test_frames_of_the_configuration_may_have_the_slash_of_ros_1():
    robot = Robot("frames.map=/map", "frames.base=/base_link")
    drive(robot, "laser", tf_at=0, steps=20)
    assert robot.walls_are_right() and not any(robot.told)


def test_an_offset_that_tf_contradicts_is_named():
    robot = Robot("sensing.sensor_offset=0.5,0,0")
    drive(robot, "laser", tf_at=0, steps=20)
    assert robot.walls_are_right()
    assert any("'laser'" in told and "sensing.sensor_offset" in told for told in robot.told)


def test_a_scan_in_the_frame_of_the_map_is_refused_by_name():
    robot = Robot()
    drive(robot, "map")
    assert robot.map.occupancy() is None
    assert any("'map'" in told and "a scan's frame is that of its lidar" in told for told in robot.told)


def test_the_odometrys_frame_is_taken_for_the_map_and_named():
    robot = Robot()
    drive(robot, "base_link", odometry="odom", mount=(0.0, 0.0, 0.0))
    assert robot.walls_are_right()
    assert any("frames.map=odom" in told for told in robot.told)


def test_an_odometry_that_tf_puts_elsewhere_in_the_map_is_refused_by_name():
    robot = Robot()
    robot.tf("map", "odom", Pose(5.0, 0.0), static=False)
    drive(robot, "base_link", odometry="odom", mount=(0.0, 0.0, 0.0))
    assert robot.map.pose is None and robot.map.occupancy() is None
    assert any("'odom'" in told and "sensing.pose=tf" in told for told in robot.told)
    same = Robot()
    same.tf("map", "odom", Pose(0.0, 0.0), static=False)
    drive(same, "base_link", odometry="odom", mount=(0.0, 0.0, 0.0))
    assert same.walls_are_right()


def test_an_odometry_that_changes_its_frame_is_refused_by_name():
    robot = Robot()
    drive(robot, "base_link", odometry="odom", steps=5, mount=(0.0, 0.0, 0.0))
    robot.take("odometry", ros.odometry(2.0, "world", "base_link", Pose(50.0, 0.0)))
    assert robot.map.pose.x < 5.0
    assert "'odom'" in robot.told[-1] and "'world'" in robot.told[-1]


def test_an_odometry_of_another_frame_of_the_robot_tells_where_the_base_is():
    robot = Robot()
    robot.tf("base_link", "tracking_camera", Pose(0.3, 0.1, pi))
    place = composed(base(0), (0.3, 0.1, pi))
    robot.take("odometry", ros.odometry(1.0, "map", "tracking_camera", place))
    assert robot.map.pose.x == pytest.approx(base(0).x) and robot.map.pose.y == pytest.approx(base(0).y)
    robot.take("odometry", ros.odometry(1.1, "map", "base_link", Pose(9.0, 9.0)))
    assert robot.map.pose.x == pytest.approx(base(0).x)
    assert "'tracking_camera'" in robot.told[-1] and "'base_link'" in robot.told[-1]
    unknown = Robot()
    unknown.take("odometry", ros.odometry(1.0, "map", "imu", place))
    assert any("'imu'" in told and "frames.base=imu" in told for told in unknown.told)


def clouds(robot: Robot, frame: str, *, in_map: bool, shift: Pose | None = None, steps: int = 30) -> None:
    """Send odometry and clouds: registered ones, perhaps in a frame that lies at `shift` in the map, or the lidar's."""
    for step in range(steps):
        robot.time = 1.0 + PERIOD * step
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base(step)))
        points = cloud_at(FREE, base(step), frame="map" if in_map else "sensor")
        if shift is not None:
            points[:, 0] -= shift.x
            points[:, 1] -= shift.y
        robot.take("points", ros.point_cloud(robot.time, frame, points))


POINTS = ("sensing.source=points", "topics.points=/points", "topics.scan=")


@pytest.mark.parametrize("setting", ["map", "sensor"])
def test_a_cloud_is_taken_in_the_frame_of_its_header_whatever_the_setting(setting):
    registered = Robot(*POINTS, f"sensing.points_frame={setting}")
    clouds(registered, "map", in_map=True)
    assert registered.walls_are_right()
    seen = Robot(*POINTS, f"sensing.points_frame={setting}")
    seen.tf("base_link", "velodyne", Pose(0.0, 0.0))
    clouds(seen, "velodyne", in_map=False)
    assert seen.walls_are_right()


def test_a_lidar_whose_height_by_tf_is_not_the_configured_one_is_named():
    robot = Robot(*POINTS)
    mount = ros.transform(0.0, "base_link", "mast", Pose(0.0, 0.0), 1.6)
    robot.take("static_transforms", ros.transform_message([mount]))
    clouds(robot, "mast", in_map=False, steps=3)
    assert any("'mast'" in told and "sensing.sensor_height" in told for told in robot.told)


def test_a_cloud_in_a_frame_that_nobody_knows_is_refused_by_name():
    robot = Robot(*POINTS)
    clouds(robot, "velodyne", in_map=False)
    assert robot.map.occupancy() is None
    assert any("'velodyne'" in told and "sensing.points_frame=sensor" in told for told in robot.told)
    taken = Robot(*POINTS, "sensing.points_frame=sensor")
    clouds(taken, "velodyne", in_map=False)
    assert taken.walls_are_right()


def test_a_cloud_that_is_registered_in_another_frame_of_the_world_is_transformed():
    robot = Robot(*POINTS)
    robot.tf("map", "camera_init", Pose(3.0, -2.0))
    clouds(robot, "camera_init", in_map=True, shift=Pose(3.0, -2.0))
    assert robot.walls_are_right()


def grid(frame: str, origin: tuple[float, float, float]) -> object:
    cells = np.where(FREE, 0, 100).astype(np.int8)
    return ros.occupancy_grid(1.0, frame, cells, RESOLUTION, origin)


def nav2() -> Robot:
    robot = Robot(profile="nav2")
    robot.tf("map", "odom", Pose(0.0, 0.0), static=False)
    robot.tf("odom", "base_link", base(0), static=False)
    return robot


def test_a_base_that_is_fixed_to_what_moves_has_poses():
    robot = Robot("sensing.pose=tf")
    robot.tf("base_footprint", "base_link", Pose(0.0, 0.0))
    for step in range(3):
        robot.time = 1.0 + PERIOD * step
        robot.tf("map", "odom", Pose(0.0, 0.0), static=False)
        assert "pose" not in robot.inputs.ages() or step > 0
        robot.tf("odom", "base_footprint", base(step), static=False)
    assert robot.inputs.stamp == pytest.approx(robot.time) and "pose" in robot.inputs.ages()


@pytest.mark.parametrize(("late", "dropped"), [(1, False), (4, False), (8, True)])
def test_a_lidar_on_a_joint_waits_for_the_joint(late, dropped):
    robot = Robot()
    for step in range(-late, 40):
        robot.time = 2.0 + PERIOD * step
        turned = [Pose(0.2, 0.0, 0.8 * np.sin(0.3 * k)) for k in (step - late, step)]
        told = ros.transform(robot.time - late * PERIOD, "base_link", "pan", turned[0])
        robot.take("transforms", ros.transform_message([told]))
        robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base(step)))
        place = composed(base(step), (turned[1].x, turned[1].y, turned[1].yaw))
        robot.take("scan", ros.laser_scan(robot.time, "pan", scan_at(FREE, place)))
    assert dropped == ("joint outdated" in robot.map.statistics.dropped)
    assert dropped == any("base_link -> pan is stamped" in told for told in robot.told)
    assert dropped or robot.walls_are_right()


def test_a_part_that_stands_still_is_published_on_tf_as_seldom_as_somebody_likes():
    robot = Robot()
    robot.time = 1.0
    robot.tf("base_link", "laser", Pose(0.2, 0.0), static=False)
    drive(robot, "laser", mount=(0.2, 0.0, 0.0))
    assert robot.walls_are_right() and robot.map.statistics.dropped == {}
    for _ in range(2):
        robot.tf("base_link", "laser", Pose(0.2, 0.0, 0.5), static=False)
        robot.time += 4.0
    robot.take("odometry", ros.odometry(robot.time, "map", "base_link", base(40)))
    robot.take("scan", ros.laser_scan(robot.time, "laser", scan_at(FREE, composed(base(40), (0.2, 0.0, 0.5)))))
    assert robot.map.statistics.waiting == 0, "it moved, but long ago"


def test_a_map_whose_z_axis_points_down_places_no_scan():
    robot = Robot("sensing.pose=tf")
    for step in range(5):
        robot.time = 1.0 + PERIOD * step
        sent = ros.transform(robot.time, "map", "base_link", base(step))
        sent.transform.rotation = message("geometry_msgs/msg/Quaternion", x=1.0, w=0.0)
        robot.take("transforms", ros.transform_message([sent]))
        robot.take("scan", ros.laser_scan(robot.time, "base_link", scan_at(FREE, base(step))))
    assert robot.map.statistics.dropped == {"base upside down": 5}
    assert "NED" in robot.told[-1]


def test_a_map_in_another_frame_waits_for_its_transform():
    robot = nav2()
    robot.take("grid", grid("slam_map", (-5.0, 1.0, 0.0)))
    assert robot.map.occupancy() is None
    assert "'slam_map'" in robot.told[-1]
    robot.tf("map", "slam_map", Pose(5.0, -1.0))
    assert robot.walls_are_right()


def test_a_map_that_comes_once_outlives_a_reset():
    robot = nav2()
    robot.take("grid", grid("/map", (0.0, 0.0, 0.0)))
    assert robot.walls_are_right()
    robot.map.reset()
    assert robot.map.refresh() is not None
    assert robot.walls_are_right()


def test_one_transform_that_is_none_does_not_hide_the_others():
    robot = Robot(profile="nav2")
    arm = ros.transform(1.0, "base_link", "gripper", Pose(0.0, 0.0))
    arm.transform.rotation = message("geometry_msgs/msg/Quaternion", w=0.0)
    far = ros.transform(1.0, "base_link", "far", Pose(float("nan"), 0.0))
    good = ros.transform(1.0, "map", "base_link", base(0))
    robot.take("transforms", ros.transform_message([arm, far, good]))
    assert robot.map.pose == base(0)
    assert robot.map.statistics.dropped == {"transform refused": 2}
    assert "gripper" in robot.told[-1] or "far" in robot.told[-1]

"""A robot with a SLAM and a stack of its own: what it is told to do when the SLAM fails, in counted time."""

from math import cos, sin

from common.geometry import Pose
from deploy.bridge.decision import DecisionLoop
from deploy.bridge.inputs import Inputs
from deploy.bridge.mission import Mission, Phase
from deploy.bridge.planner_selector import make_planners
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from deploy.robot.slam import RobotSlam
from deploy.ros2 import Received
from deploy.ros2 import conversions as ros
from deploy.safety.health import HealthMonitor
from tests.common.planners.worlds import ROOMS

SETTINGS = ["decision.planner=nearest", "mapping.resolution=0.25", "mapping.viewpoint_spacing=2"]
RANGE = 10.0


class Robot:
    """Goes to each waypoint in a straight line at 1 m/s; its SLAM publishes a map in each second."""

    def __init__(self):
        config = load_deploy_config(None, [*SETTINGS, f"mapping.sensor_range={RANGE}"], {}, "nav2")
        self.now, self.ticks = 1000.0, 0
        self.map = RobotMap(config)
        self.health = HealthMonitor(config.safety, sensor="grid")
        self.inputs = Inputs(config, self.map, self.health)
        self.mission = Mission("exploration")
        self.loop = DecisionLoop(
            config.decision,
            config.mapping,
            config.safety,
            self.map,
            make_planners(config),
            self.mission,
            self.health,
            clock=lambda: self.now,
        )
        self.odometry = Pose(*ROOMS.start)
        self.slam_lives = True
        self.begin_map(Pose(0.0, 0.0))

    def begin_map(self, correction):
        """Start the SLAM anew, with the odometry's origin at a pose in its map."""
        self.correction = correction
        self.slam = RobotSlam(ROOMS, 0.25, RANGE, 360)

    def tick(self):
        self.now += 0.1
        received = Received(self.now, round(self.now * 1e9), 0)
        links = [("odom", "base_link", self.odometry)]
        if self.slam_lives:
            links.insert(0, ("map", "odom", self.correction))
        self.inputs.take_transforms(ros.transform_message([ros.transform(self.now, *link) for link in links]), received)
        if self.slam_lives and self.ticks % 10 == 0:
            self.slam.look(self.odometry)
            cells, size, (x, y) = self.slam.grid()
            corner = self._in_map(Pose(x, y))
            grid = ros.occupancy_grid(self.now, "map", cells, size, (corner.x, corner.y, corner.yaw))
            self.inputs.take_grid(grid, received)
        self.ticks += 1
        outcome = self.loop.step()
        if outcome.course is not None:
            self._drive(outcome.course.waypoint)
        return outcome

    def run(self, seconds, until=lambda _: False):
        for _ in range(round(10 * seconds)):
            outcome = self.tick()
            if until(outcome):
                break
        return outcome

    def _in_map(self, pose):
        by = self.correction
        x, y = cos(by.yaw) * pose.x - sin(by.yaw) * pose.y, sin(by.yaw) * pose.x + cos(by.yaw) * pose.y
        return Pose(by.x + x, by.y + y, by.yaw + pose.yaw)

    def _drive(self, waypoint):
        here = self._in_map(self.odometry)
        share = min(0.1 / max(here.distance_to(waypoint), 0.1), 1.0)
        x, y = share * (waypoint[0] - here.x), share * (waypoint[1] - here.y)
        yaw = self.correction.yaw
        self.odometry = Pose(
            self.odometry.x + cos(yaw) * x + sin(yaw) * y, self.odometry.y + cos(yaw) * y - sin(yaw) * x, 0.0
        )


def started(seconds=15.0):
    robot = Robot()
    robot.mission.start()
    assert robot.run(seconds).course is not None
    return robot


def test_a_slam_that_falls_silent_is_named_and_taken_up_again():
    robot = started(3.0)
    robot.slam_lives = False
    first = robot.run(8.0, lambda outcome: bool(outcome.hold))
    last = robot.run(2.0)
    for outcome in (first, last):
        assert "the transform map -> odom is stamped" in outcome.hold
        assert outcome.course is None
    assert [fault.kind.value for fault in last.faults] == ["pose_stale"]
    robot.slam_lives = True
    assert robot.run(2.0).course is not None


def test_home_is_not_looked_for_in_the_map_of_a_slam_that_began_anew():
    robot = started()
    home = robot.mission.orders.home
    robot.begin_map(Pose(-20.0, 3.0, -1.2))
    outcome = robot.run(3.0)
    assert outcome.faults[0].kind.value == "map_misplaced"
    assert "it began a new map" in outcome.hold
    robot.mission.return_home()
    assert robot.run(5.0).course is None
    robot.mission.reset()
    robot.tick()
    assert robot.mission.orders.phase is Phase.ABORTED
    assert "odometry or SLAM began anew" in robot.mission.orders.reason
    robot.mission.start()
    outcome = robot.run(3.0)
    assert outcome.course is not None
    assert outcome.orders.home not in {None, home}


def test_a_loop_that_is_closed_holds_the_robot_for_a_moment():
    robot = started()
    home = robot.mission.orders.home
    robot.correction = Pose(2.9, 0.1, 0.02)
    assert robot.tick().faults[0].kind.value == "pose_jump"
    outcome = robot.run(3.0)
    assert outcome.faults == ()
    assert outcome.course is not None
    assert outcome.orders.home == home

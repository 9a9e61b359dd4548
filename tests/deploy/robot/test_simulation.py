import math

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from common.errors import MapError
from common.mapping.belief import Belief
from deploy.config import DeployConfig
from deploy.profiles import load_deploy_config
from deploy.robot.options import RobotOptions
from deploy.robot.simulation import SimulatedRobot, centred, load_world

WORLD = "generator:rooms?width=192&height=192&seed=5"


@pytest.fixture
def make():
    made = []

    def build(profile="bare", overrides=(), **settings):
        config = load_deploy_config(profile=profile, overrides=overrides)
        made.append(SimulatedRobot(RobotOptions(map=WORLD, **settings), config))
        return made[-1]

    yield build
    for robot in made:
        robot.close()


def live(robot, seconds, velocity=None):
    moments = []
    for _ in range(round(seconds / robot.interval)):
        if velocity is not None:
            robot.base.receive(*velocity, robot.time, robot.time)
        moments.append(robot.step(robot.time))
    return moments


def test_the_robot_starts_at_the_origin_of_its_map_and_sees_its_walls(make):
    robot = make()
    moments = live(robot, 1.0)
    assert robot.pose.distance_to((0.0, 0.0)) < 0.05
    scans = [moment.scan for moment in moments if moment.scan is not None]
    assert len(scans) == pytest.approx(10, abs=1)
    assert scans[0].range_min > 0.0
    belief = Belief(robot.world.resolution, 20.0)
    belief.integrate(scans[-1], robot.pose)
    seen = belief.window(robot.world.origin, robot.world.free.shape)
    assert (seen == 0).sum() > 200
    assert np.mean(robot.world.free[seen == 0]) > 0.99


def test_velocities_move_the_robot_and_odometry_tells_them(make):
    robot = make()
    moments = live(robot, 2.0, (0.0, 1.0))
    told = [moment for moment in moments if moment.odometry_due]
    assert len(told) == pytest.approx(60, abs=2)
    assert told[-1].velocity[1] == pytest.approx(1.0, abs=0.05)
    assert told[-1].odometry == told[-1].truth == robot.pose
    assert robot.pose.yaw == pytest.approx(1.94, abs=0.1)
    live(robot, 1.5)
    assert live(robot, 0.1)[-1].velocity == pytest.approx((0.0, 0.0), abs=0.02)


def test_driving_into_a_wall_is_counted(make):
    robot = make()
    live(robot, 20.0, (1.0, 0.0))
    assert robot.collisions >= 1
    assert robot.distance > 0.5


def test_with_drift_the_correction_leads_from_odometry_to_the_truth(make):
    robot = make("nav2", odometry_drift=0.2, seed=2)
    live(robot, 1.0)
    moment = live(robot, 6.0, (0.3, 0.8))[-1]
    assert moment.odometry.distance_to(moment.truth.position) > 1e-3
    assert moment.estimate == moment.truth
    x, y, yaw = moment.correction
    cosine, sine = math.cos(yaw), math.sin(yaw)
    odometry = moment.odometry
    assert x + cosine * odometry.x - sine * odometry.y == pytest.approx(moment.truth.x, abs=1e-9)
    assert y + sine * odometry.x + cosine * odometry.y == pytest.approx(moment.truth.y, abs=1e-9)


def test_the_robots_own_mapping_gives_a_growing_grid(make):
    robot = make("nav2", map_rate=2.0, overrides=["mapping.resolution=0.1"])
    grids = [moment.grid for moment in live(robot, 1.6, (0.0, 2.0)) if moment.grid is not None]
    assert len(grids) == pytest.approx(4, abs=1)
    assert grids[-1].resolution == 0.1
    assert set(np.unique(grids[-1].cells)) == {-1, 0, 100}


def test_a_registered_cloud_lies_on_the_walls_and_a_raw_one_around_the_sensor(make):
    robot = make("cmu", rays=180)
    cloud = next(moment.cloud for moment in live(robot, 0.3) if moment.cloud is not None)
    assert cloud.dtype == np.float32
    walls = cloud[(cloud[:, 2] > 0.2) & (cloud[:, 2] < 1.5)]
    assert len(walls) > 500
    world = robot.world
    column = np.floor((walls[:, 0] - world.origin[0]) / world.resolution).astype(int)
    row = np.floor((walls[:, 1] - world.origin[1]) / world.resolution).astype(int)
    near = [
        not world.free[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].all() for r, c in zip(row, column, strict=True)
    ]
    assert np.mean(near) > 0.99
    raw = make("cmu", overrides=["sensing.points_frame=sensor"], rays=180)
    points = next(moment.cloud for moment in live(raw, 0.3) if moment.cloud is not None)
    assert points[:, 2].min() == pytest.approx(-raw.lidar_height, abs=0.05)


def test_the_same_seed_gives_the_same_life(make):
    def life():
        robot = make(range_noise=0.02, odometry_drift=0.05, seed=4)
        moments = live(robot, 2.0, (0.4, 0.7))
        return moments[-1].odometry, np.stack([m.scan.ranges for m in moments if m.scan is not None])

    (first, scans), (second, again) = life(), life()
    assert first == second
    assert np.array_equal(scans, again)


def test_a_world_is_moved_to_where_the_robot_starts():
    options = RobotOptions(map=WORLD)
    world = load_world(options)
    moved = centred(world)
    assert moved.is_free((0.0, 0.0))
    assert moved.target == pytest.approx(np.subtract(world.target, world.start))


def test_an_unknown_world_is_one_clear_error():
    with pytest.raises(MapError, match="no generator"):
        load_world(RobotOptions(map="generator:castle"))
    with pytest.raises(MapError, match=r"nowhere\.png"):
        load_world(RobotOptions(map="nowhere.png"))


def test_layers_and_following_come_from_the_profile():
    assert RobotOptions().lidar_layers(DeployConfig().topics) == 1
    assert RobotOptions().lidar_layers(load_deploy_config(profile="cmu").topics) == 16
    assert RobotOptions(layers=1).lidar_layers(load_deploy_config(profile="cmu").topics) == 1
    assert RobotOptions().follows(load_deploy_config(profile="cmu").driving)
    assert not RobotOptions().follows(load_deploy_config(profile="bare").driving)

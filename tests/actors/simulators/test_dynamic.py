import math

import numpy as np
import psutil
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from actors.simulators.bullet import pybullet
from actors.simulators.dynamic import CONTROL_INTERVAL, DynamicSimulator
from actors.simulators.physics_world import PhysicsWorld
from actors.simulators.robot import Robot
from common.config import SimulatorConfig
from common.errors import SimulatorError
from tests.actors.simulators.worlds import RANGE, ROUTE, at, block, hall, rooms


@pytest.fixture
def make():
    made = []

    def build(**settings):
        made.append(DynamicSimulator(SimulatorConfig(fidelity="dynamic", **settings), RANGE))
        return made[-1]

    yield build
    for simulator in made:
        simulator.close()


@pytest.fixture
def robot():
    physics = PhysicsWorld(2.0)
    physics.load(hall(40.0, 20.0))
    robot = Robot(physics, at(5.125, 5.125), collides=True)

    def run(speed, turn_rate, seconds):
        robot.command(speed, turn_rate)
        for _ in range(round(seconds * 240)):
            pybullet.stepSimulation(physicsClientId=physics.client)
        return robot.pose

    robot.run = run
    robot.run(0.0, 0.0, 0.2)
    yield robot
    physics.close()


def test_the_robot_stands_level_and_has_the_measures_of_its_file(robot):
    pose, height, tilt = robot.state()
    assert pose.distance_to((5.125, 5.125)) < 1e-3
    assert abs(height) < 2e-3
    assert tilt < math.radians(0.2)
    assert (robot.wheel_radius, robot.track, robot.radius) == pytest.approx((0.1, 0.38, 0.25))


def test_the_robot_drives_straight(robot):
    robot.run(1.0, 0.0, 0.5)
    before = robot.pose
    after = robot.run(1.0, 0.0, 5.0)
    assert after.x - before.x == pytest.approx(5.0, rel=0.01)
    assert abs(after.y - before.y) < 0.05
    assert abs(after.yaw) < 0.02


def test_the_robot_turns_by_the_right_amount_and_stays_in_place(robot):
    robot.run(0.0, 1.0, 0.5)
    before = robot.pose
    after = robot.run(0.0, 1.0, 1.5)
    assert after.yaw - before.yaw == pytest.approx(1.5, rel=0.03)
    assert after.distance_to((5.125, 5.125)) < 0.03


def test_legs_end_at_their_waypoints_with_scans_at_the_rate_of_the_lidar(make):
    sim = make(lidar_rate=10.0)
    sim.reset(hall(), seed=0)
    for waypoint in ((9.125, 5.125), (13.125, 9.125), (13.125, 5.125), (5.125, 5.125)):
        leg = sim.drive_to(waypoint)
        assert leg.reached
        assert leg.collisions == 0
        assert leg.pose == sim.pose
        assert leg.pose.distance_to(waypoint) < 0.06
        assert len(leg.sensed) == pytest.approx(leg.duration * 10.0, abs=2.5)
    assert leg.distance == pytest.approx(8.0, abs=0.15)
    speeds = [10.0 * a.distance_to(b.position) for (a, _), (b, _) in zip(leg.sensed, leg.sensed[1:], strict=False)]
    assert max(speeds) == pytest.approx(2.0, rel=0.05)


def test_a_watch_takes_the_scans_on_the_way_and_stops_the_robot(make):
    sim = make(lidar_rate=10.0)
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((13.125, 5.125), lambda pose, scan: pose.x > 8.0)
    assert leg.stopped and not leg.reached and leg.sensed == []
    # It brakes from 2 m/s.
    assert 8.0 < leg.pose.x < 10.0
    assert sim.drive_to((13.125, 5.125)).reached


def test_speed_is_the_configured_one(make):
    sim = make(speed=0.5)
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((9.125, 5.125))
    assert leg.reached
    assert 8.0 < leg.duration < 9.0


def test_driving_into_a_wall_is_a_collision_and_the_robot_recovers(make):
    sim = make()
    sim.reset(block(hall(), 9.0, 1.0, 0.5, 14.0), seed=0)
    leg = sim.drive_to((13.125, 5.125))
    assert not leg.reached
    assert leg.collisions == 1
    assert leg.pose.x < 9.0 - 0.25
    back = sim.drive_to((5.125, 9.125))
    assert back.reached
    assert back.collisions == 0


def test_a_waypoint_beside_a_wall_counts_as_reached_when_the_robot_stands_over_it(make):
    sim = make()
    sim.reset(hall(), seed=0)
    leg = sim.drive_to((1.125, 5.125))
    assert leg.reached
    assert leg.pose.distance_to((1.125, 5.125)) < 0.25
    assert sim.drive_to((5.125, 5.125)).reached


def test_a_pillar_of_one_cell_blocks(make):
    sim = make()
    sim.reset(block(hall(), 9.0, 5.0), seed=0)
    leg = sim.drive_to((12.125, 5.125))
    assert leg.collisions >= 1


def test_a_start_beside_a_wall_is_moved_to_where_the_robot_fits(make):
    sim = make()
    pose = sim.reset(hall(start=(1.125, 1.125)), seed=0)
    assert 1.25 < pose.x < 1.6
    assert 1.25 < pose.y < 1.6
    assert sim.drive_to((5.125, 5.125)).collisions == 0


def test_a_place_without_room_is_refused(make):
    sim = make()
    world = hall(start=(5.125, 5.125))
    world.free[:] = False
    world.free[20, 20] = True
    with pytest.raises(SimulatorError, match="no room"):
        sim.reset(world, seed=0)


def test_a_robot_that_tips_over_is_an_error(make):
    sim = make()
    sim.reset(hall(), seed=0)
    pybullet.resetBasePositionAndOrientation(
        sim._robot.body, (5.0, 5.0, 0.4), (0.5, 0.0, 0.0, 0.866), physicsClientId=sim.physics.client
    )
    with pytest.raises(SimulatorError, match="left the floor"):
        sim.drive_to((9.125, 5.125))
    sim.reset(hall(), seed=0)
    assert sim.drive_to((9.125, 5.125)).reached


def test_the_same_seed_gives_the_same_episode_bit_by_bit(make):
    def episode(sim, seed):
        sim.reset(rooms(), seed=seed)
        legs = [sim.drive_to(waypoint) for waypoint in ROUTE[:2]]
        return [leg.pose for leg in legs], np.stack([scan.ranges for leg in legs for _, scan in leg.sensed])

    first, second = make(range_noise=0.02), make(range_noise=0.02)
    poses, scans = episode(first, 3)
    second.reset(hall(), seed=9)
    second.drive_to((9.125, 9.125))
    again_poses, again_scans = episode(second, 3)
    assert poses == again_poses
    assert np.array_equal(scans, again_scans)


def test_the_robot_does_not_drift_while_it_stands(make):
    sim = make()
    before = sim.reset(hall(), seed=0)
    for _ in range(600):
        sim.advance(0.0, 0.0)
    assert before.distance_to(sim.pose.position) < 1e-3
    assert abs(sim.pose.yaw - before.yaw) < 1e-3


def test_a_robot_driven_by_velocities_goes_where_they_lead(make):
    sim = make()
    start = sim.reset(hall(), seed=0)
    for _ in range(round(3.0 / CONTROL_INTERVAL)):
        pose = sim.advance(1.0, 0.5)
    assert pose == sim.pose
    # An arc of 1.5 rad with a radius of 2 m.
    assert pose.yaw == pytest.approx(1.5, abs=0.1)
    assert pose.x - start.x == pytest.approx(2.0 * math.sin(1.5), abs=0.25)
    assert pose.y - start.y == pytest.approx(2.0 * (1.0 - math.cos(1.5)), abs=0.25)
    assert sim.collisions == 0
    for _ in range(round(20.0 / CONTROL_INTERVAL)):
        sim.advance(1.0, 0.0)
    assert sim.collisions == 1


def test_the_cloud_comes_in_the_frame_that_is_asked_for(make):
    sim = make(lidar_layers=16, rays=90)
    sim.reset(hall(), seed=0)
    for _ in range(60):
        sim.advance(0.0, 1.0)
    sim.scan()
    pose, height = sim.pose, sim.lidar_height
    assert height == pytest.approx(0.45, abs=0.01)
    ours = sim.point_cloud(in_sensor=True)
    cosine, sine = math.cos(pose.yaw), math.sin(pose.yaw)
    turned = ours[:, :2] @ np.array([[cosine, sine], [-sine, cosine]]) + pose.position
    cloud = sim.point_cloud()
    assert np.abs(turned - cloud[:, :2]).max() < 0.1
    assert np.abs(ours[:, 2] + height - cloud[:, 2]).max() < 0.1


def test_memory_does_not_grow_with_resets(make):
    sim = make(rays=90)
    process = psutil.Process()

    def resets(count):
        for seed in range(count):
            sim.reset(rooms(), seed=seed)
            sim.drive_to((5.625, 5.125))
        return process.memory_info().rss

    before = resets(20)
    assert resets(60) - before < 2**20

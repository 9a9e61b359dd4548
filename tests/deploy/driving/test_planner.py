import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from tests.deploy.driving.vehicle import Vehicle, pillar, run, wall

CONFIG = DrivingConfig()
NOTHING = np.empty((0, 2))
# One planner for all: `reset` and a far pose make it new.
PLANNER = LocalPlanner(CONFIG)


ORIGIN = Pose(0.0, 0.0)


def drive(world, path, start=ORIGIN, **arguments):
    vehicle = Vehicle(start, world)
    planner = arguments.pop("planner", None) or LocalPlanner(CONFIG)
    reached, seconds, blocked, commands = run(vehicle, path, CONFIG, planner=planner, **arguments)
    assert vehicle.nearest >= CONFIG.robot_radius
    return vehicle, reached, seconds, blocked, commands


def test_drives_straight_at_full_speed():
    _, reached, seconds, blocked, commands = drive(NOTHING, [(8.0, 0.0)])
    assert reached
    assert not blocked
    assert seconds < 8.0 / CONFIG.max_speed + 2.0
    assert max(command.linear for command in commands) == CONFIG.max_speed
    assert not any(command.reason for command in commands)


def test_turns_on_the_spot_when_the_path_is_behind():
    vehicle, reached, _, _, _ = drive(NOTHING, [(5.0, 0.0)], Pose(0.0, 0.0, math.pi))
    assert reached
    assert vehicle.travelled < 5.1


def test_follows_corners_of_the_path():
    vehicle, reached, _, _, _ = drive(NOTHING, [(3.0, 0.0), (3.0, 3.0), (6.0, 3.0)])
    assert reached
    assert 7.5 < vehicle.travelled < 9.2


def test_follows_a_path_that_leads_back_over_itself():
    vehicle, reached, _, _, _ = drive(NOTHING, [(0.0, 0.0), (4.0, 0.0), (4.0, 0.5), (-1.0, 0.0)], seconds=30.0)
    assert reached
    assert vehicle.travelled > 7.5


def test_goes_round_a_loop_whose_end_passes_the_start():
    vehicle, planner, corner = Vehicle(Pose(0.1, 0.1, 1.5), NOTHING), LocalPlanner(CONFIG), (0.0, 2.4)
    path = [(0.3, 0.0), corner, (2.2, 2.0), (0.2, 0.3), (0.2, -3.0)]
    nearest = math.inf
    for _ in range(600):
        vehicle.drive(planner.command(vehicle.pose, vehicle.velocity, path, NOTHING, 0.05), 0.05)
        nearest = min(nearest, vehicle.pose.distance_to(corner))
    assert nearest < 0.5
    assert vehicle.pose.distance_to(path[-1]) < 0.15


def test_goes_on_where_it_was_after_it_stood():
    vehicle, planner = Vehicle(Pose(0.0, 0.0), NOTHING), LocalPlanner(CONFIG)
    path = [(0.0, 0.0), (4.0, 0.0), (4.0, 0.6), (0.0, 0.6)]
    for turn in range(400):
        if turn == 160:
            assert vehicle.pose.y > 0.4, "on its way back"
            planner.reset()
        vehicle.drive(planner.command(vehicle.pose, vehicle.velocity, path, NOTHING, 0.05), 0.05)
    assert vehicle.pose.distance_to(path[-1]) < 0.15
    assert vehicle.travelled < 9.5


def test_stops_at_the_end():
    planner = LocalPlanner(CONFIG)
    vehicle, reached, _, _, _ = drive(NOTHING, [(2.0, 0.0)], planner=planner, until=0.07)
    assert reached
    for _ in range(30):
        command = planner.command(vehicle.pose, vehicle.velocity, [(2.0, 0.0)], NOTHING, 0.05)
        vehicle.drive(command, 0.05)
    assert (command.linear, command.angular) == (0.0, 0.0)
    assert command.reason == "the end of the path is reached"
    assert vehicle.pose.distance_to((2.0, 0.0)) < 0.15


@pytest.mark.parametrize("start", [Pose(0.0, 0.0, 0.0), Pose(1.0, 2.0, -1.0), Pose(1.5, -2.0, 2.0)])
def test_passes_a_door_of_one_metre(start):
    door = np.vstack((wall((3.0, 0.5), (3.0, 4.0)), wall((3.0, -0.5), (3.0, -4.0))))
    _, reached, _, blocked, _ = drive(door, [(6.0, 0.0)], start)
    assert reached
    assert not blocked


def test_goes_around_what_stands_on_the_path():
    _, reached, _, blocked, _ = drive(pillar(3.0, 0.05, 0.5), [(6.0, 0.0)])
    assert reached
    assert not blocked


def test_does_not_drive_into_a_dead_end_that_it_sees():
    trap = np.vstack((wall((3.0, -1.0), (3.0, 1.0)), wall((1.5, -1.0), (3.0, -1.0)), wall((1.5, 1.0), (3.0, 1.0))))
    vehicle, reached, _, blocked, _ = drive(trap, [(5.0, 0.0)])
    assert reached
    assert not blocked
    assert vehicle.travelled < 8.0


def test_says_that_it_is_blocked():
    vehicle, reached, _, blocked, commands = drive(wall((3.0, -9.0), (3.0, 9.0)), [(5.0, 0.0)], seconds=40.0)
    assert not reached
    assert blocked
    assert next(command for command in commands if command.blocked).reason
    assert vehicle.nearest >= CONFIG.robot_radius + 0.5 * CONFIG.clearance


def test_backs_out_of_a_cul_de_sac():
    walls = np.vstack((wall((-2.0, 0.4), (1.0, 0.4)), wall((-2.0, -0.4), (1.0, -0.4)), wall((1.0, -0.4), (1.0, 0.4))))
    _, reached, _, _, _ = drive(walls, [(-4.0, 0.0)], Pose(0.6, 0.0))
    assert reached


def test_leaves_an_obstacle_that_is_too_near_already():
    beside = wall((-0.5, 0.27), (0.5, 0.27))
    vehicle, reached, _, _, _ = drive(beside, [(4.0, -1.0)])
    assert reached
    assert vehicle.nearest >= 0.268


def test_brakes_for_an_obstacle_that_appears():
    planner, vehicle = LocalPlanner(CONFIG), Vehicle(Pose(0.0, 0.0), NOTHING)
    for _ in range(40):
        vehicle.drive(planner.command(vehicle.pose, vehicle.velocity, [(20.0, 0.0)], NOTHING, 0.05), 0.05)
    assert vehicle.velocity[0] > 0.9
    vehicle.world = wall((vehicle.pose.x + 1.2, -9.0), (vehicle.pose.x + 1.2, 9.0))
    for _ in range(40):
        vehicle.drive(planner.command(vehicle.pose, vehicle.velocity, [(20.0, 0.0)], vehicle.sees(), 0.05), 0.05)
    assert vehicle.nearest > CONFIG.robot_radius


def test_remembers_what_is_too_near_to_be_seen():
    vehicle = Vehicle(Pose(0.0, 0.0), wall((1.5, -3.0), (1.5, 3.0)))
    planner = LocalPlanner(CONFIG)
    for _ in range(200):
        seen = vehicle.sees()
        gaps = np.hypot(seen[:, 0] - vehicle.pose.x, seen[:, 1] - vehicle.pose.y)
        command = planner.command(vehicle.pose, vehicle.velocity, [(1.3, 0.0)], seen[gaps > 0.35], 0.05)
        vehicle.drive(command, 0.05)
    assert vehicle.nearest >= CONFIG.robot_radius


def test_no_path_and_no_pose_stop():
    planner = LocalPlanner(CONFIG)
    assert planner.command(Pose(0.0, 0.0), (0.0, 0.0), [], NOTHING, 0.05).reason == "there is no path"
    command = planner.command(Pose(math.nan, 0.0), (0.5, 0.0), [(1.0, 0.0)], NOTHING, 0.05)
    assert (command.linear, command.reason) == (0.0, "the pose is not finite")
    odd = np.array([(math.nan, 0.0), (math.inf, 1.0)])
    assert planner.command(Pose(0.0, 0.0), (0.0, 0.0), [(2.0, 0.0)], odd, 0.05).linear > 0.0


@pytest.mark.parametrize("radius", [0.1, 0.6])
def test_robots_of_other_sizes(radius):
    config = DrivingConfig(robot_radius=radius)
    gap = radius + 0.25
    door = np.vstack((wall((3.0, gap), (3.0, 4.0)), wall((3.0, -gap), (3.0, -4.0))))
    vehicle = Vehicle(Pose(0.0, 0.0), door)
    reached, *_ = run(vehicle, [(6.0, 0.0)], config)
    assert reached
    assert vehicle.nearest >= radius


finite = st.floats(-4.0, 4.0)


@settings(max_examples=60)
@given(
    start=st.tuples(finite, finite, finite),
    path=st.lists(st.tuples(finite, finite), min_size=1, max_size=4),
    obstacles=st.lists(st.tuples(finite, finite), max_size=30),
    velocities=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.5, 1.5)), min_size=2, max_size=6),
    dt=st.floats(0.02, 0.2),
)
def test_limits_hold_whatever_comes(start, path, obstacles, velocities, dt):
    PLANNER.reset()
    last = None
    for velocity in velocities:
        command = PLANNER.command(Pose(*start), velocity, path, np.array(obstacles).reshape(-1, 2), dt)
        assert abs(command.linear) <= CONFIG.max_speed
        assert abs(command.angular) <= CONFIG.max_turn_rate
        if last is not None:
            # From the last command, or from what the robot does instead.
            for new, old, measured, limit in (
                (command.linear, last.linear, velocity[0], CONFIG.max_acceleration),
                (command.angular, last.angular, velocity[1], CONFIG.max_turn_acceleration),
            ):
                low, high = min(old, measured), max(old, measured)
                assert low - limit * dt - 1e-9 <= new <= high + limit * dt + 1e-9
                if abs(old - measured) <= 0.3 * limit:
                    assert abs(new - old) <= limit * dt + 1e-9
        last = command


@pytest.mark.parametrize("acceleration", [0.2, 0.3])
def test_rolling_on_before_it_turns_back_is_no_standstill(acceleration):
    config = DrivingConfig(max_acceleration=acceleration)
    vehicle, planner = Vehicle(ORIGIN, NOTHING), LocalPlanner(config)
    run(vehicle, [(9.0, 0.0)], config, seconds=7.0, planner=planner)
    assert vehicle.velocity[0] > 0.9
    reached, _, blocked, commands = run(vehicle, [(vehicle.pose.x, 0.0), (-2.0, 0.0)], config, planner=planner)
    assert reached
    assert not blocked
    assert not {"backing off", "looking for a way"} & {command.reason for command in commands}

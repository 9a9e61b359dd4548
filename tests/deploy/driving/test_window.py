import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import Command
from deploy.driving.costmap import LocalCostmap
from deploy.driving.window import DynamicWindow, Motion
from tests.deploy.driving.vehicle import Vehicle, wall

CONFIG = DrivingConfig()
WINDOW = DynamicWindow(CONFIG)


def look(world, motion: Motion) -> None:
    costmap = LocalCostmap(CONFIG)
    costmap.update(*motion.pose.position, np.asarray(world, float).reshape(-1, 2), 0.0)
    WINDOW.look(costmap, motion, CONFIG.lookahead)


def stand(speed: float = 0.0) -> Motion:
    return Motion(Pose(0.0, 0.0), (speed, 0.0), (speed, 0.0), 0.05)


def test_steps_are_limited():
    assert WINDOW.step(stand(), (1.0, -9.0)) == pytest.approx((0.05, -0.15))
    assert WINDOW.step(stand(1.0), (5.0, 0.0)) == (1.0, 0.0)


@pytest.mark.parametrize(("gap", "safe"), [(1.30, True), (0.75, False)])
def test_full_speed_needs_the_way_to_brake(gap, safe):
    look(wall((gap, -2.0), (gap, 2.0)), stand(1.0))
    assert WINDOW.safe(stand(1.0), (1.0, 0.0)) is safe


def test_nothing_is_chosen_that_touches():
    look(wall((0.33, -2.0), (0.33, 2.0)), stand())
    chosen = WINDOW.choose(stand(), (3.0, 0.0), 1.0, 0.0)
    assert chosen is not None
    assert chosen[0][0] < 0.05


@settings(max_examples=80)
@given(
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=1, max_size=15),
    st.floats(0.0, 1.0),
    st.floats(-1.5, 1.5),
)
def test_a_safe_command_can_be_followed_by_a_stop(points, speed, turn):
    world = np.array([point for point in points if math.hypot(*point) > 0.32])
    motion = Motion(Pose(0.0, 0.0), (speed, turn), (speed, turn), 0.05)
    look(world, motion)
    command = WINDOW.step(motion, (speed, turn))
    if not WINDOW.safe(motion, command):
        return
    vehicle = Vehicle(Pose(0.0, 0.0), world)
    vehicle.velocity = speed, turn
    vehicle.drive(Command(*command), 0.05)
    while abs(vehicle.velocity[0]) > 0.01:
        base = Motion(vehicle.pose, vehicle.velocity, command, 0.05)
        command = WINDOW.step(base, (0.0, 0.0))
        vehicle.drive(Command(*command), 0.05)
    assert vehicle.nearest >= CONFIG.robot_radius + 0.8 * CONFIG.clearance

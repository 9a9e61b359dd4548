"""A robot that is longer than wide: its outline touches nothing, and it passes where its circle would not."""

import math

import numpy as np
import pytest

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import LocalPlanner
from tests.deploy.driving.vehicle import Vehicle, run, wall

LONG = ((0.5, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.5, -0.2))
CONFIG = DrivingConfig(footprint=LONG)


class Box(Vehicle):
    """Measures how near obstacles come to the outline, at every step of its motion."""

    def __init__(self, pose, world):
        self.gap = math.inf
        super().__init__(pose, world)

    def drive(self, command, seconds):
        for _ in range(round(seconds / 0.01)):
            super().drive(command, 0.01)
            offsets = self.world - self.pose.position
            cosine, sine = math.cos(self.pose.yaw), math.sin(self.pose.yaw)
            along = offsets[:, 0] * cosine + offsets[:, 1] * sine
            across = offsets[:, 1] * cosine - offsets[:, 0] * sine
            outside = np.hypot(
                np.maximum(np.maximum(along - 0.5, -0.4 - along), 0.0), np.maximum(np.abs(across) - 0.2, 0.0)
            )
            self.gap = min(self.gap, float(outside.min()))


def drive(world, path, start=Pose(0.0, 0.0), **arguments):  # noqa: B008  (a value)
    vehicle = Box(start, np.concatenate(world))
    reached, _, _, _ = run(vehicle, path, CONFIG, planner=LocalPlanner(CONFIG), **arguments)
    return vehicle, reached


def test_it_passes_a_door_that_is_narrower_than_its_diagonal():
    door = [wall((2.0, 0.33), (2.0, 4.0)), wall((2.0, -4.0), (2.0, -0.33))]
    vehicle, reached = drive(door, [(4.0, 0.0)])
    assert reached
    assert vehicle.gap > 0.0


def test_it_does_not_turn_where_it_would_hit_a_wall():
    # A corridor of 0.8 m, in which it fits lengthwise alone; the target is behind it.
    corridor = [wall((-4.0, 0.4), (4.0, 0.4)), wall((-4.0, -0.4), (4.0, -0.4))]
    vehicle, _ = drive(corridor, [(-3.0, 0.0)], seconds=12.0)
    assert vehicle.gap > 0.0
    assert abs(vehicle.pose.yaw) < math.asin(0.8) / 2.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_its_tail_does_not_sweep_into_a_wall_when_it_turns_off(side):
    world = [wall((-2.0, -0.35 * side), (6.0, -0.35 * side)), wall((2.5, 1.2 * side), (6.0, 1.2 * side))]
    vehicle, reached = drive(world, [(1.2, 0.0), (1.5, 3.0 * side)])
    assert reached
    assert vehicle.gap > 0.0

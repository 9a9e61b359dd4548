"""Small worlds and comparisons for the tests of simulators."""

import numpy as np

from actors.maps.grid_map import GridMap
from common.geometry import Pose, Scan
from common.mapping.belief import Belief

RESOLUTION = 0.25
RANGE = 20.0


def make_world(free, start=(5.125, 5.125), origin=(0.0, 0.0)):
    return GridMap(
        name="test",
        free=np.ascontiguousarray(free),
        resolution=RESOLUTION,
        origin=origin,
        start=start,
        target=None,
        target_region=None,
        lattice_origin=start,
    )


def hall(width=20.0, height=16.0, start=(5.125, 5.125), origin=(0.0, 0.0)):
    """An empty hall with walls of 1 m: free from 1 m to size - 1 m."""
    free = np.zeros((round(height / RESOLUTION), round(width / RESOLUTION)), dtype=np.bool_)
    free[4:-4, 4:-4] = True
    return make_world(free, start, origin)


def block(world, x, y, width=RESOLUTION, height=RESOLUTION):
    """Put an obstacle with its lower left corner at (x, y) into a world."""
    row, column = world.cell((x + 1e-6, y + 1e-6))
    world.free[row : row + round(height / RESOLUTION), column : column + round(width / RESOLUTION)] = False
    return world


def rooms():
    """Two rooms with a door, a corridor around a corner, and pillars of one cell."""
    world = hall(28.0, 20.0)
    block(world, 13.0, 1.0, 0.5, 7.0)
    block(world, 13.0, 10.0, 0.5, 9.0)
    block(world, 17.0, 12.0, 10.0, 0.25)
    for x, y in ((8.0, 8.0), (9.5, 3.0), (4.25, 12.5), (20.0, 5.0), (20.25, 5.25), (23.0, 9.0)):
        block(world, x, y)
    return world


ROUTE = ((5.125, 10.125), (10.125, 9.125), (16.125, 9.125), (16.125, 15.125), (22.125, 16.125))


def filled(scan: Scan) -> np.ndarray:
    """Ranges with `range_max` where nothing was met."""
    return np.where(np.isinf(scan.ranges), scan.range_max, scan.ranges)


def empty_belief(world) -> Belief:
    (x, y), (width, height) = world.origin, world.size
    return Belief(world.resolution, RANGE, bounds=(x, y, x + width, y + height))


def agreement(world, first: Belief, second: Belief) -> float:
    """Share of cells, among those that either belief knows, in which the two are equal."""
    a = first.window(world.origin, world.free.shape)
    b = second.window(world.origin, world.free.shape)
    known = (a != -1) | (b != -1)
    return float(np.mean(a[known] == b[known]))


def at(x, y, yaw=0.0):
    return Pose(x, y, yaw)

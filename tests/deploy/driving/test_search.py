from itertools import pairwise
from math import dist

import numpy as np

from deploy.config import DrivingConfig
from deploy.driving.costmap import LocalCostmap
from deploy.driving.search import find_way
from tests.deploy.driving.vehicle import wall

CONFIG = DrivingConfig()


def costmap(world) -> LocalCostmap:
    made = LocalCostmap(CONFIG)
    made.update(0.0, 0.0, world, 0.0)
    return made


def test_straight_way_without_obstacles():
    way = find_way(costmap(np.empty((0, 2))), (0.0, 0.0), (3.0, 0.0))
    assert (way[0], way[-1]) == ((0.0, 0.0), (3.0, 0.0))
    assert sum(dist(a, b) for a, b in pairwise(way)) < 3.3


def test_way_around_keeps_its_room():
    made = costmap(wall((1.5, -1.0), (1.5, 1.0)))
    way = np.array(find_way(made, (0.0, 0.0), (3.0, 0.0)))
    gaps = np.hypot(*(way[:, None] - made.points[None]).transpose(2, 0, 1))
    assert gaps.min() >= made.room
    assert abs(way[:, 1]).max() > 1.0


def test_no_way():
    assert find_way(costmap(wall((1.5, -5.0), (1.5, 5.0))), (0.0, 0.0), (3.0, 0.0)) == []
    assert find_way(costmap(np.empty((0, 2))), (0.0, 0.0), (30.0, 0.0)) == []


def test_way_out_of_a_place_that_is_too_near():
    way = find_way(costmap(wall((0.22, -1.0), (0.22, 1.0))), (0.0, 0.0), (-2.0, 0.0))
    assert way[-1] == (-2.0, 0.0)

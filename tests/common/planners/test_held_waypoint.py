"""A waypoint several edges away: kept on the way, given up for a reason."""

from __future__ import annotations

import numpy as np

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.held_waypoint import HeldWaypoint
from tests.common.mapping.worlds import see, small_config


def hall(target: tuple[float, float] | None = None) -> tuple[Mapper, np.ndarray]:
    free = np.ones((24, 60), dtype=np.bool_)
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    mapper = Mapper(small_config(viewpoint_spacing=1.0, sensor_range=12.0), lattice_origin=(1.0, 1.0), target=target)
    see(mapper, free, Pose(3.0, 5.0))
    return mapper, free


def node_at(mapper: Mapper, x: float, y: float) -> int:
    return int(np.argmin(np.hypot(*(mapper.viewpoints - (x, y)).T)))


def test_it_is_kept_until_the_robot_is_there():
    mapper, free = hall()
    held = HeldWaypoint(1.0)
    assert held.node(mapper, Pose(3.0, 5.0)) is None
    held.hold(mapper, node_at(mapper, 8.0, 5.0))
    for x in (3.0, 5.0, 6.4, 7.0):
        see(mapper, free, Pose(x, 5.0))
        assert held.node(mapper, Pose(x, 5.0)) == node_at(mapper, 8.0, 5.0)
    see(mapper, free, Pose(8.0, 5.0))
    assert held.node(mapper, Pose(8.0, 5.0)) is None
    see(mapper, free, Pose(5.0, 5.0))
    assert held.node(mapper, Pose(5.0, 5.0)) is None


def test_a_robot_that_does_not_move_decides_anew():
    mapper, _ = hall()
    held = HeldWaypoint(1.0)
    held.hold(mapper, node_at(mapper, 8.0, 5.0))
    answers = [held.node(mapper, Pose(3.0, 5.0)) is None for _ in range(5)]
    assert answers == [False, False, False, True, True]


def test_a_wall_that_makes_the_way_longer_or_takes_the_viewpoint_ends_it():
    mapper, free = hall()
    held = HeldWaypoint(1.0)
    held.hold(mapper, node_at(mapper, 8.0, 5.0))
    assert held.node(mapper, Pose(3.0, 5.0)) is not None
    free[1:20, 12] = False
    see(mapper, free, Pose(4.0, 5.0))
    assert held.node(mapper, Pose(4.0, 5.0)) is None

    mapper, free = hall()
    held.hold(mapper, node_at(mapper, 8.0, 5.0))
    free[9:11, 15:17] = False
    see(mapper, free, Pose(4.0, 5.0))
    assert held.node(mapper, Pose(4.0, 5.0)) is None


def test_a_target_that_becomes_known_asks_for_a_decision():
    mapper, free = hall(target=(20.2, 5.0))
    held = HeldWaypoint(1.0)
    held.hold(mapper, node_at(mapper, 9.0, 5.0))
    see(mapper, free, Pose(5.0, 5.0))
    assert held.node(mapper, Pose(5.0, 5.0)) is not None
    see(mapper, free, Pose(8.5, 5.0))
    assert mapper.target_known
    assert held.node(mapper, Pose(8.5, 5.0)) is None
    held.hold(mapper, len(mapper.viewpoints))
    assert held.node(mapper, Pose(8.5, 5.0)) == len(mapper.viewpoints)

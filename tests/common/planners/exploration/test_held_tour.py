"""A tour that is kept while nothing new is seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position
from common.planners.exploration.held_tour import HeldTour
from tests.common.planners.worlds import ROOMS, looked


def _node(mapper: Mapper, place: Position) -> int:
    return int(np.argmin(np.hypot(*(mapper.viewpoints - place).T)))


def _stops(held: HeldTour, mapper: Mapper, candidates: NDArray[np.int64], tour: list[int]) -> list[int]:
    return held.stops(mapper, candidates, mapper.viewpoints, lambda: tour)


def test_a_tour_that_turns_round_at_each_viewpoint_is_kept_at_the_second_visit() -> None:
    mapper, pose = looked(ROOMS)
    left, right = pose.position, (pose.x + 4.0, pose.y)
    far = _node(mapper, (pose.x + 4.0, pose.y - 4.0))
    held = HeldTour()
    begun = []
    for step in range(6):
        here, there = (left, right) if step % 2 == 0 else (right, left)
        mapper.update(Pose(*here))
        # From each of the two the tour begins with the other.
        tour = [_node(mapper, there), far]
        begun.append(mapper.position(_stops(held, mapper, np.array([far, *tour]), tour)[0]))
    # Kept from the third decision on: the second viewpoint of the two, then what is beyond.
    assert begun == [right, left, right, *[mapper.position(far)] * 3]


def test_a_kept_tour_loses_the_stops_that_are_done_with_and_ends() -> None:
    mapper, pose = looked(ROOMS)
    first, second, other = (
        _node(mapper, (pose.x + dx, pose.y + dy)) for dx, dy in ((4.0, 0.0), (0.0, -4.0), (4.0, -4.0))
    )
    every = np.array([first, second, other])
    held = HeldTour()
    for _ in range(2):
        assert _stops(held, mapper, every, [first, second]) == [first, second]
    assert _stops(held, mapper, every, [other]) == [first, second]
    assert _stops(held, mapper, np.array([second, other]), [other]) == [second]
    assert _stops(held, mapper, np.array([other]), [other]) == [other]


def test_news_let_it_plan_anew() -> None:
    mapper, pose = looked(ROOMS)
    first, other = (_node(mapper, (pose.x + dx, pose.y)) for dx in (4.0, 8.0))
    held = HeldTour()
    for _ in range(2):
        _stops(held, mapper, np.array([first, other]), [first])
    assert _stops(held, mapper, np.array([first, other]), [other]) == [first]
    places = [mapper.position(first), mapper.position(other)]
    seen, _ = looked(ROOMS, [pose.position, (pose.x + 4.0, pose.y + 4.0)])
    assert seen.belief.known_cells > mapper.belief.known_cells
    nodes = [_node(seen, place) for place in places]
    assert _stops(held, seen, np.array(nodes), [nodes[1]]) == [nodes[1]]

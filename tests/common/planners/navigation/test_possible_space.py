from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.mapping.belief import Belief
from common.mapping.clearance import Clearance
from common.mapping.sight import FREE, NOTHING_LOST, OCCUPIED, UNKNOWN
from common.planners.navigation.possible_space import PossibleSpace

CHOICES = np.array([UNKNOWN, FREE, FREE, FREE, OCCUPIED], dtype=np.int8)


def config_of(radius: float) -> MappingConfig:
    return MappingConfig(resolution=0.5, robot_radius=radius, viewpoint_spacing=2.0)


def belief_of(cells: np.ndarray) -> Belief:
    belief = Belief(0.5, 5.0)
    belief.assign(cells, (0.0, 0.0))
    return belief


def room(gap: int) -> Belief:
    """10 m x 6 m, of which the left half is known; a wall at 5 m with a gap of so many cells."""
    cells = np.full((12, 20), UNKNOWN, dtype=np.int8)
    cells[:, :10] = FREE
    cells[:, 10] = OCCUPIED
    cells[4 : 4 + gap, 10] = UNKNOWN
    return belief_of(cells)


@pytest.mark.parametrize(("radius", "gap", "fits"), [(0.0, 1, True), (0.6, 2, False), (0.6, 3, True), (0.9, 3, False)])
def test_the_robot_may_go_where_it_fits(radius: float, gap: int, fits: bool) -> None:
    space = PossibleSpace(config_of(radius))
    # The ways around the wall, through what was not seen, are closed.
    belief = room(gap)
    belief.assign(np.full((1, 60), OCCUPIED, dtype=np.int8), (-10.0, -0.5))
    belief.assign(np.full((1, 60), OCCUPIED, dtype=np.int8), (-10.0, 6.0))
    belief.assign(np.full((12, 1), OCCUPIED, dtype=np.int8), (19.5, 0.0))
    belief.assign(np.full((12, 1), OCCUPIED, dtype=np.int8), (-10.0, 0.0))
    start, goal = (2.0, 3.0), (8.0, 3.0)
    space.update(belief, start, goal)
    assert space.joined(start, goal) == fits
    way = space.way(start, goal)
    assert (way is not None) == fits
    if way is not None:
        assert way[-1] == goal


def test_a_place_in_the_margin_stands_for_the_nearest_where_the_robot_fits() -> None:
    space = PossibleSpace(config_of(0.6))
    space.update(room(0), (2.0, 3.0), (4.9, 3.0))
    assert not space.at_ease((4.9, 3.0))
    assert space.joined((2.0, 3.0), (4.9, 3.0))
    # All points of the cells up to x = 4 are clear, and the middles of those up to 4.5.
    assert space.near((4.9, 3.0), 1.5) == (3.75, 2.75)
    assert space.near((4.9, 3.0), 1.0) is None
    way = space.way((2.0, 3.0), (4.9, 3.0))
    assert way is not None
    assert way[-1] == (4.25, 2.75)
    # Behind the wall no margin is near enough.
    assert not space.joined((2.0, 3.0), (5.25, 3.0))


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), radius=st.sampled_from([0.0, 0.4, 0.8, 1.3]))
def test_clear_space_follows_the_belief(seed: int, radius: float) -> None:
    random = np.random.default_rng(seed)
    belief = belief_of(random.choice(CHOICES, (16, 18), p=[0.3, 0.3, 0.2, 0.15, 0.05]))
    space = PossibleSpace(config_of(radius))
    before = np.zeros((0, 0), dtype=np.int8)
    for step in range(4):
        box = space.update(belief, (1.0, 1.0))
        world = space.world
        fresh = Clearance(world, radius)
        rows, columns = world.padded.shape
        fresh.refresh(world.padded, (1, rows - 2, 1, columns - 2), NOTHING_LOST)
        assert np.array_equal(space.clear, fresh.grid)
        if not space.resized:
            where = np.argwhere(space.clear != before)
            assert (box is None) == (len(where) == 0) or radius == 0.0
            for row, column in where.tolist():
                assert box is not None
                assert box[0] <= row <= box[1]
                assert box[2] <= column <= box[3]
        before = space.clear.copy()
        low = -4 if step == 1 else 0
        part = random.choice(CHOICES, tuple(random.integers(1, 8, 2)))
        belief.assign(part, (0.5 * int(random.integers(low, 16)), 0.5 * int(random.integers(low, 12))))

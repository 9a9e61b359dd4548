import dataclasses

import numpy as np
import pytest

from actors.tasks import ExplorationGoal, NavigationGoal, make_goal
from actors.tasks.coverage import Coverage
from common.config import TaskConfig
from common.errors import MapError
from common.geometry import Pose
from tests.actors.worlds import draw

WORLD = draw(
    "#########",
    "#S..#...#",
    "#...#...#",
    "#..T#...#",
    "#########",
)


def belief(world, seen):
    """Cells of a belief of the world's own frame: what is seen is free or occupied, the rest unknown."""
    return np.where(seen, np.where(world.free, 0, 100), -1).astype(np.int8)


def test_coverage_counts_what_can_be_reached():
    coverage = Coverage(WORLD)
    assert coverage.unseen_area == pytest.approx(9.0)
    assert coverage.explored == 0.0
    seen = np.zeros_like(WORLD.free)
    seen[2:4] = True  # the bottom metre of the left room, and of the right one, which does not count
    coverage.update(belief(WORLD, seen), 0.5, (0.0, 0.0))
    assert coverage.unseen_area == pytest.approx(6.0)
    assert coverage.explored == pytest.approx(1 / 3)


def test_coverage_follows_a_belief_that_grows():
    coverage = Coverage(WORLD)
    small = np.zeros((4, 4), dtype=np.int8)
    coverage.update(small, 0.5, (1.0, 1.0))
    assert coverage.unseen_area == pytest.approx(5.0)
    coverage.update(np.full((40, 40), -1, dtype=np.int8), 0.5, (-4.0, -4.0))
    assert coverage.unseen_area == pytest.approx(5.0), "what was seen stays seen"
    coverage.update(np.zeros((40, 40), dtype=np.int8), 0.5, (-4.0, -4.0))
    assert coverage.unseen_area == 0.0
    assert coverage.explored == 1.0


def test_coverage_at_a_coarser_belief():
    coverage = Coverage(WORLD)
    coverage.update(np.zeros((3, 5), dtype=np.int8), 2.0, (0.0, 0.0))
    assert coverage.unseen_area == 0.0


def test_a_start_in_a_wall_is_an_error():
    with pytest.raises(MapError, match="start"):
        Coverage(dataclasses.replace(WORLD, start=(0.1, 0.1)))


CABIN = draw(
    "##########",
    "#S...#...#",
    "#........#",
    "#....#...#",
    "##########",
    resolution=0.25,
)


@pytest.mark.parametrize(("radius", "columns"), [(0.0, 9), (0.35, 9), (0.6, 4)])
def test_coverage_counts_where_the_robot_fits(radius, columns):
    coverage = Coverage(CABIN, radius)
    rows, cells = np.divmod(coverage.unseen_cells, CABIN.free.shape[1])
    # Behind a door of 1 m lies a room that a robot of 1.2 m cannot enter; margins along walls do not count.
    x, y = (cells + 0.5) * 0.25, (rows + 0.5) * 0.25
    assert x.max() > columns - 1
    assert x.max() < columns + 1 - radius
    assert y.min() >= 1.0 + radius
    assert x.min() >= 1.0 + radius
    assert coverage.explored == 0.0


def test_a_robot_that_starts_beside_a_wall_counts_the_room():
    beside = dataclasses.replace(CABIN, start=(1.1, 3.9))
    assert np.array_equal(Coverage(beside, 0.4).unseen_cells, Coverage(CABIN, 0.4).unseen_cells)
    with pytest.raises(MapError, match="does not fit"):
        Coverage(CABIN, 1.6)


def test_the_largest_unseen_region_has_an_area_and_a_place():
    coverage = Coverage(CABIN)
    seen = np.ones_like(CABIN.free)
    seen[4:16, 24:36] = False
    seen[4:6, 4:6] = False
    coverage.update(np.where(seen, np.where(CABIN.free, 0, 100), -1).astype(np.int8), 0.25, (0.0, 0.0))
    found = coverage.largest_unseen()
    assert found is not None
    area, (x, y) = found
    assert area == pytest.approx(9.0)
    assert (x, y) == pytest.approx((7.5, 2.5), abs=0.2)
    assert coverage.unseen_area == pytest.approx(9.25)
    coverage.update(np.where(CABIN.free, 0, 100).astype(np.int8), 0.25, (0.0, 0.0))
    assert coverage.largest_unseen() is None


def test_the_place_lies_in_a_region_that_goes_round_something():
    world = draw("#######", "#S....#", "#.###.#", "#.###.#", "#.....#", "#######", resolution=0.25)
    found = Coverage(world).largest_unseen()
    assert found is not None
    assert found[0] == pytest.approx(14.0)
    assert world.is_free(found[1])


def test_exploration_is_complete_at_the_tolerance():
    coverage = Coverage(WORLD)
    goal = make_goal(TaskConfig(name="exploration", unseen_area=6.0))
    goal.reset(WORLD)
    assert isinstance(goal, ExplorationGoal)
    assert not goal.complete(coverage, Pose(1.5, 3.5))
    seen = np.zeros_like(WORLD.free)
    seen[2:4] = True
    coverage.update(belief(WORLD, seen), 0.5, (0.0, 0.0))
    assert goal.complete(coverage, Pose(1.5, 3.5))


def test_navigation_is_complete_near_the_target():
    goal = make_goal(TaskConfig(name="navigation", arrival_radius=1.6))
    goal.reset(WORLD)
    assert isinstance(goal, NavigationGoal)
    assert goal.target == (3.5, 1.5)
    coverage = Coverage(WORLD)
    assert goal.complete(coverage, Pose(3.5, 3.0))
    assert not goal.complete(coverage, Pose(3.5, 3.2))
    assert goal.progress(Pose(3.5, 3.5)) == pytest.approx(2.0)


def test_navigation_is_complete_inside_the_marker():
    region = np.zeros_like(WORLD.free)
    region[2:8, 2:4] = True
    goal = NavigationGoal(TaskConfig(arrival_radius=0.1))
    goal.reset(dataclasses.replace(WORLD, target_region=region))
    coverage = Coverage(WORLD)
    assert goal.complete(coverage, Pose(1.2, 3.7))
    assert not goal.complete(coverage, Pose(2.2, 3.7))


def test_navigation_needs_a_target():
    with pytest.raises(MapError, match="no target"):
        NavigationGoal(TaskConfig(arrival_radius=1.6)).reset(dataclasses.replace(WORLD, target=None))

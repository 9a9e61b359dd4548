"""The random tree and the roadmap."""

from __future__ import annotations

import numpy as np
import pytest

from common.mapping.mapper import Mapper
from common.planners.exploration.roadmap import Roadmap, trace
from common.planners.exploration.rrt import Tree, free_box
from tests.common.planners.rollout import drawn
from tests.common.planners.worlds import ARMS, CONFIG, ROOMS, looked


def _tree(capacity: int = 60) -> tuple[Tree, object]:
    mapper, pose = looked(ROOMS)
    box = free_box(mapper.belief)
    assert box is not None
    samples = box[0] + np.random.default_rng(0).random((600, 2)) * (box[1] - box[0])
    tree = Tree(pose.position)
    tree.extend(mapper.belief, samples, capacity=capacity, step=3.0, spread=0.5)
    return tree, mapper


def test_tree_keeps_its_promises() -> None:
    mapper, pose = looked(ROOMS)
    tree, _ = _tree()
    assert len(tree.points) == 60
    assert tree.points[0].tolist() == list(pose.position)
    for node in range(1, 60):
        parent = int(tree.parents[node])
        assert 0 <= parent < node
        length = np.hypot(*(tree.points[node] - tree.points[parent]))
        assert length <= 3.0 + 1e-4
        assert tree.depths[node] == pytest.approx(tree.depths[parent] + length, abs=1e-3)
        a, b = tree.points[node].tolist(), tree.points[parent].tolist()
        assert mapper.segment_free((a[0], a[1]), (b[0], b[1]))
    gaps = np.hypot(*(tree.points[:, None] - tree.points[None]).transpose(2, 0, 1)) + 10.0 * np.eye(60)
    assert gaps.min() >= 0.5 - 1e-4


def test_branch_leads_from_the_root() -> None:
    tree, _ = _tree()
    way = [0, *tree.branch(59)]
    assert way[-1] == 59
    assert [int(tree.parents[node]) for node in way[1:]] == way[:-1]
    assert tree.branch(0) == []


def test_free_box_of_nothing() -> None:
    from common.mapping.belief import Belief

    assert free_box(Belief(0.5, 10.0)) is None


def test_roadmap_joins_what_is_in_sight_and_in_reach() -> None:
    mapper, pose = looked(ARMS)
    x, y = pose.position
    roadmap = Roadmap(5.0)
    roadmap.add(mapper.belief, np.array([[x, y], [x + 4.0, y], [x + 4.0, y + 3.5], [x - 5.0, y]]))
    joined = np.isfinite(roadmap.lengths) & (roadmap.lengths > 0.0)
    # The third place is around a corner of the first, and the second is too far from the fourth.
    assert {tuple(pair) for pair in np.argwhere(joined).tolist()} == {(0, 1), (1, 0), (1, 2), (2, 1), (0, 3), (3, 0)}
    distances, before = roadmap.shortest(3)
    assert distances == pytest.approx([5.0, 9.0, 12.5, 0.0])
    assert trace(before, 2) == [3, 0, 1, 2]


def test_roadmap_drops_places_and_keeps_apart() -> None:
    mapper, pose = looked(ARMS)
    x, y = pose.position
    roadmap = Roadmap(5.0)
    way = np.array([[x, y], [x + 0.5, y], [x + 3.0, y], [x + 3.2, y]])
    roadmap.add_ways(mapper.belief, way, np.arange(-1, 3), [0, 1, 2, 3], 1.0)
    assert roadmap.points.tolist() == [[x, y], [x + 3.0, y]]
    roadmap.keep(np.array([1]))
    assert roadmap.points.tolist() == [[x + 3.0, y]]
    assert roadmap.lengths.tolist() == [[0.0]]


def test_roadmap_keeps_a_way_together_that_passes_places_behind_a_wall() -> None:
    world = drawn(["#######", "#S....#", "#####.#", "#.....#", "#######"])
    mapper, _ = looked(world, [(world.start[0] + dx, world.start[1] + dy) for dx, dy in [(0, 0), (16, 0), (16, -8)]])
    x, y = world.start
    # The way goes around the wall; the roadmap has the places before it, not far from those behind.
    way = np.array([[x, y], [x + 8.0, y], [x + 16.0, y], [x + 16.0, y - 4.0], [x + 16.0, y - 8.0], [x + 8.0, y - 8.0]])
    roadmap = Roadmap(9.0)
    roadmap.add(mapper.belief, np.array([[x, y], [x + 8.0, y], [x + 14.5, y]]))
    roadmap.add_ways(mapper.belief, way, np.arange(-1, 5), list(range(6)), 8.5)
    assert np.isfinite(roadmap.shortest(0)[0]).all()
    ends = np.hypot(*(roadmap.points - way[-1]).T)
    assert any(mapper.segment_free((x + 8.0, y - 8.0), (px, py)) for px, py in roadmap.points[ends <= 8.5].tolist())


def test_roadmap_notices_a_new_wall() -> None:
    mapper, pose = looked(ARMS)
    x, y = pose.position
    roadmap = Roadmap(5.0)
    roadmap.add(mapper.belief, np.array([[x, y], [x + 4.0, y]]))
    wall = np.full((8, 1), 100, dtype=np.int8)
    mapper.belief.assign(wall, (x + 2.0, y - 2.0))
    roadmap.recheck(mapper.belief)
    assert np.isinf(roadmap.lengths[0, 1])


def test_roadmap_notices_a_new_opening() -> None:
    mapper, pose = looked(ARMS)
    x, y = pose.position
    roadmap = Roadmap(5.0)
    unknown = Mapper(CONFIG, lattice_origin=ARMS.lattice_origin, bounds=(x - 20.0, y - 20.0, x + 20.0, y + 20.0))
    roadmap.add(unknown.belief, np.array([[x, y], [x + 4.0, y]]))
    assert np.isinf(roadmap.lengths[0, 1])
    roadmap.recheck(mapper.belief)
    assert roadmap.lengths[0, 1] == pytest.approx(4.0)

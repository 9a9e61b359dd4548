"""Whole explorations on hand-made plans: the graph leads wherever the robot fits, and shows all that can be seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actors.maps.connectivity import label_regions, reachable
from actors.maps.image_map import load_image
from common.config import MappingConfig
from tests.common.mapping.walks import Walk
from tests.plans import RADIUS, RESOLUTION, SPACING, all_plans, clear_cells

FLOOR_PLANS = Path(__file__).parents[4] / "shared" / "data" / "maps" / "floorplans"
CONFIG = MappingConfig(resolution=RESOLUTION, sensor_range=20.0, viewpoint_spacing=SPACING, robot_radius=RADIUS)
UNKNOWN, FREE, OCCUPIED = -1, 0, 100


def pieces_of(clear: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Number the 4-connected parts of each square's clear cells from 1; 0 elsewhere, int, shape of the world."""
    labels = np.zeros(clear.shape, dtype=np.int64)
    for number in np.unique(square[clear]):
        inside = clear & (square == number)
        regions, _ = label_regions(inside, diagonal=False)
        labels[inside] = regions[inside] - regions[inside].min() + 1 + labels.max()
    return labels


def touching(labels: np.ndarray) -> set[tuple[int, int]]:
    pairs: set[tuple[int, int]] = set()
    for a, b in ((labels[1:], labels[:-1]), (labels[:, 1:], labels[:, :-1])):
        borders = (a != b) & (a > 0) & (b > 0)
        pairs |= set(zip(a[borders].tolist(), b[borders].tolist(), strict=True))
    return pairs | {(b, a) for a, b in pairs}


def assert_leads_where_the_robot_fits(walk: Walk, *, everywhere: bool) -> None:
    """The nodes are the pieces of what is connected with the robot in the inflated grid.

    Unless they are to be ``everywhere``, one may be missing whose square is partly unknown without a wall seen in it,
    and what only such pieces lead to.
    """
    mapper, world = walk.mapper, walk.world
    belief = mapper.belief.window(world.origin, world.free.shape)
    connected = reachable(clear_cells(belief == FREE, RADIUS), world.cell(walk.pose.position))
    rows, columns = np.indices(belief.shape)
    middles = (np.stack([columns, rows], axis=-1) + 0.5) * RESOLUTION
    i, j = np.floor((middles - world.lattice_origin) / SPACING + 0.5).astype(int).transpose(2, 0, 1)
    square = (j - j.min()) * (i.max() - i.min() + 1) + i - i.min()
    labels = pieces_of(connected, square)
    node = mapper.nodes_at(middles[connected])
    # A piece has one node or none, and a node one piece.
    pairs = np.unique(np.stack([labels[connected], node], axis=1), axis=0)
    assert len(np.unique(pairs[:, 0])) == len(pairs)
    present = pairs[pairs[:, 1] >= 0]
    assert sorted(present[:, 1].tolist()) == list(range(len(mapper.viewpoints)))
    missing = set(pairs[pairs[:, 1] < 0, 0].tolist())
    if everywhere:
        assert not missing
    may_wait = {
        label
        for label in missing
        for inside in [belief[square == square[labels == label][0]]]
        if (inside == UNKNOWN).any() and not (inside == OCCUPIED).any()
    }
    neighbours: dict[int, list[int]] = {}
    for a, b in touching(labels):
        neighbours.setdefault(a, []).append(b)
    stack = [int(labels[world.cell(walk.pose.position)])]
    found = set(stack)
    while stack:
        new = [piece for piece in neighbours.get(stack.pop(), []) if piece not in found and piece not in may_wait]
        found.update(new)
        stack += new
    assert not found & missing


@pytest.mark.parametrize("plan", all_plans(), ids=lambda plan: plan.world.name)
def test_the_whole_floor_is_seen(plan):
    walk = Walk(plan.world, CONFIG)
    for _ in range(500):
        assert_leads_where_the_robot_fits(walk, everywhere=False)
        if not walk.step():
            break
    assert not len(walk.goals()), "the walk does not end"
    assert_leads_where_the_robot_fits(walk, everywhere=True)
    assert walk.measure() <= 1.0
    nodes = walk.mapper.nodes_at(np.array(list(plan.rooms.values())))
    assert {name for name, node in zip(plan.rooms, nodes, strict=True) if node >= 0} == plan.reachable


@pytest.mark.slow
@pytest.mark.skipif(not FLOOR_PLANS.is_dir(), reason="the public floor plans are not in ../shared/data/maps/floorplans")
@pytest.mark.parametrize(("name", "radius"), [("50052750_1", RADIUS), ("50052750_1", 0.0), ("50052749_0", 0.0)])
def test_a_real_floor_plan_is_seen_to_its_last_room(name, radius):
    walk = Walk(load_image(FLOOR_PLANS / f"{name}.png", RESOLUTION), CONFIG.model_copy(update={"robot_radius": radius}))
    for _ in range(1500):
        if not walk.step():
            break
    assert not len(walk.goals()), "the walk does not end"
    if radius > 0.0:
        assert walk.measure() <= 5.0
        assert_leads_where_the_robot_fits(walk, everywhere=True)
    else:
        assert walk.measure() == 0.0

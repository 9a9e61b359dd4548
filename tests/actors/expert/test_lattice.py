import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.expert.lattice import TrueLattice, line_free
from common.observation import NEIGHBOUR_OFFSETS
from tests.actors.worlds import draw


def touched(x0, y0, x1, y1, rows, columns):
    """Cells that a segment touches, from the definition: closed cells that meet it, by dense clipping."""
    found = []
    for r in range(rows):
        for c in range(columns):
            low, high = 0.0, 1.0
            for start, change, side in ((x0, x1 - x0, c), (y0, y1 - y0, r)):
                if change == 0:
                    if not side <= start <= side + 1:
                        low, high = 1.0, 0.0
                    continue
                a, b = (side - start) / change, (side + 1 - start) / change
                low, high = max(low, min(a, b)), min(high, max(a, b))
            if low <= high:
                found.append((r, c))
    return found


quarters = st.integers(0, 32).map(lambda k: k / 4)


@settings(deadline=None, max_examples=200)
@given(quarters, quarters, quarters, quarters, st.integers(0, 2**32 - 1))
def test_line_of_sight_is_free_of_every_touched_wall(x0, y0, x1, y1, seed):
    free = np.random.default_rng(seed).random((9, 9)) < 0.9
    cells = touched(x0, y0, x1, y1, 9, 9)
    leaves = min(x0, y0, x1, y1) == 0.0 or max(x0, y0, x1, y1) == 9.0
    expected = all(free[cell] for cell in cells) and not leaves
    assert line_free(free, x0, y0, x1, y1) == expected
    assert line_free(free, x1, y1, x0, y0) == expected


def test_a_corridor_has_known_distances():
    world = draw("##############", "#S...........#", "##############", lattice=(0.5, 1.5))
    lattice = TrueLattice.build(world, 2.0)
    # Lattice points at x = 0.5 + 2 i: those from 2.5 to 12.5 are free.
    assert len(lattice) == 6
    distances = lattice.distances()
    assert distances[0] == pytest.approx(np.arange(6) * 2.0)
    assert np.array_equal(distances, distances.T)


def test_edges_are_symmetric_and_walls_cut_them():
    world = draw("#########", "#S..#...#", "#...#...#", "#.......#", "#########")
    lattice = TrueLattice.build(world, 1.0)
    for v in range(len(lattice)):
        for k in range(20):
            u = lattice.table[v, k]
            if u >= 0:
                assert lattice.table[u, 19 - k] == v
                assert np.allclose((lattice.points[u] - lattice.points[v]) * world.resolution, NEIGHBOUR_OFFSETS[k])
    left = int(lattice.index[3 - lattice.first[1], 3 - lattice.first[0]])
    right = int(lattice.index[3 - lattice.first[1], 5 - lattice.first[0]])
    assert left >= 0
    assert right >= 0
    # Round the wall's end at (4.5, 1.5): two edges of sqrt(5) would touch the wall's corner.
    assert lattice.distances()[left, right] == pytest.approx(2 * 2 + 2)

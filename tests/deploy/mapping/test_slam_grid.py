"""The SLAM's own map as cells of the common one."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MappingError
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.config import SensingConfig
from deploy.mapping.slam_grid import SlamGrid, classify, resample, strangeness

SENSING = SensingConfig()


def grid_of(cells: object, resolution: float = 0.05, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SlamGrid:
    return SlamGrid(np.array(cells, dtype=np.int8), resolution, origin)


def test_probabilities_become_three_states():
    cells = np.array([[-1, 0, 25, 26, 64, 65, 100, 101, -7]], dtype=np.int8)
    expected = [UNKNOWN, FREE, FREE, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN]
    assert classify(cells, SENSING)[0].tolist() == expected


def test_strange_maps_are_told():
    assert strangeness(np.array([[-1, 0, 100, 20, 70]], dtype=np.int8), SENSING) == ""
    assert "thresholds" not in strangeness(np.full((3, 3), -1, dtype=np.int8), SENSING)
    assert "neither" in strangeness(np.array([[0, 100, 120]], dtype=np.int8), SENSING)
    assert "grid_free" in strangeness(np.array([[0, 50, 50, 50]], dtype=np.int8), SENSING)
    assert "nothing is an obstacle" in strangeness(np.array([[0, 0, 10, -1]], dtype=np.int8), SENSING)
    assert strangeness(np.array([[0, 0, -1]], dtype=np.int8), SENSING) == "", "an open field"
    assert "nothing is free" in strangeness(np.array([[100, 100, -1]], dtype=np.int8), SENSING)


def test_a_map_of_the_same_cells_stays_as_it_is():
    rng = np.random.default_rng(0)
    cells = rng.choice([-1, 0, 100], size=(37, 53)).astype(np.int8)
    # An origin as SLAM packages publish it, and an anchor some cells away from it.
    grid = grid_of(cells, 0.05, (-12.34, 5.67, 0.0))
    out, row, column = resample(grid, SENSING, 0.05, (-12.34 + 0.05 * 7, 5.67 - 0.05 * 3))
    assert (row, column) == (3, -7)
    assert np.array_equal(out, cells)


def test_coarser_cells_take_the_worst_of_what_they_hold():
    cells = np.zeros((8, 8), dtype=np.int8)
    cells[1, 2] = 100
    cells[6, 1] = -1
    cells[5, 6], cells[6, 6] = 100, -1
    out, _, _ = resample(grid_of(cells), SENSING, 0.2, (0.0, 0.0))
    assert out.tolist() == [[OCCUPIED, FREE], [UNKNOWN, OCCUPIED]]


def test_a_cell_that_reaches_beyond_the_map_is_unknown():
    out, _, _ = resample(grid_of(np.zeros((6, 6))), SENSING, 0.2, (0.0, 0.0))
    assert out.tolist() == [[FREE, UNKNOWN], [UNKNOWN, UNKNOWN]]


def test_finer_cells_copy_the_one_they_lie_in():
    out, _, _ = resample(grid_of([[0, 100]], 0.4), SENSING, 0.2, (0.0, 0.0))
    assert out.tolist() == [[FREE, FREE, OCCUPIED, OCCUPIED]] * 2


@given(
    st.integers(0, 10**6),
    st.sampled_from([0.05, 0.1, 0.13]),
    st.sampled_from([0.1, 0.2, 0.07]),
    st.floats(-3.2, 3.2),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
)
def test_resampling_never_hides_an_obstacle_and_never_invents_free_space(seed, resolution, target, yaw, origin):
    rng = np.random.default_rng(seed)
    cells = rng.choice([-1, 0, 0, 0, 0, 100], size=(12, 15)).astype(np.int8)
    grid = grid_of(cells, resolution, (*origin, yaw))
    out, row, column = resample(grid, SENSING, target, (0.0, 0.0))
    # Points anywhere in the middle of source cells.
    i, j = np.meshgrid(np.arange(12), np.arange(15), indexing="ij")
    u, v = (j + rng.uniform(0.1, 0.9, j.shape)) * resolution, (i + rng.uniform(0.1, 0.9, i.shape)) * resolution
    x = origin[0] + u * np.cos(yaw) - v * np.sin(yaw)
    y = origin[1] + u * np.sin(yaw) + v * np.cos(yaw)
    there = out[np.floor(y / target).astype(int) - row, np.floor(x / target).astype(int) - column]
    assert (there[cells == OCCUPIED] == OCCUPIED).all()
    assert (there[cells == UNKNOWN] != FREE).all()


def test_what_is_no_map_is_refused():
    for grid in (
        grid_of(np.zeros((0, 4))),
        grid_of(np.zeros(4)),
        grid_of([[0]], 0.0),
        grid_of([[0]], 0.1, (float("nan"), 0.0, 0.0)),
    ):
        with pytest.raises(MappingError, match="OccupancyGrid"):
            grid.check()


def test_a_coarse_map_is_measured_before_anything_is_allocated_for_its_cells():
    grid = grid_of(np.zeros((2000, 2000), np.int8), 1.0)
    tracemalloc.start()
    try:
        with pytest.raises(MappingError, match="2000 x 2000 cells of 1 m would become 20000 x 20000 cells of 0.1 m"):
            resample(grid, SENSING, 0.1, (0.0, 0.0))
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()

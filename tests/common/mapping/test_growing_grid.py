"""A grid that grows keeps its cells, their numbers and what changed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MappingError
from common.mapping.growing_grid import GrowingGrid

spans = st.tuples(st.integers(-40, 40), st.integers(1, 20)).map(lambda span: (span[0], span[0] + span[1]))


class Numbers(GrowingGrid):
    max_cells = 200 * 200

    def __init__(self):
        super().__init__(0.5, (1.0, -2.0))
        self.values = np.zeros((0, 0), dtype=int)

    def _move(self, before):
        values = np.zeros(self.shape, dtype=int)
        if before is not None:
            values[before[0] : before[1], before[2] : before[3]] = self.values
        self.values = values


class Blocks(Numbers):
    block = 8


@pytest.mark.parametrize("kind", [Numbers, Blocks])
@given(rectangles=st.lists(st.tuples(spans, spans), min_size=1, max_size=6))
def test_cells_keep_their_numbers_and_changes_their_place(kind, rectangles):
    grid, kept = kind(), {}
    for value, (rows, columns) in enumerate(rectangles, 1):
        grid.cover(*rows, *columns)
        (row, column), (height, width) = grid.first_cell, grid.shape
        assert row <= rows[0] and rows[1] <= row + height and column <= columns[0] and columns[1] <= column + width
        assert row % grid.block == column % grid.block == height % grid.block == width % grid.block == 0
        grid.values[rows[0] - row, columns[0] - column] = value
        grid.note((rows[0] - row, rows[0] - row, columns[0] - column, columns[0] - column))
        kept[rows[0], columns[0]] = value
    (row, column), (height, width) = grid.first_cell, grid.shape
    assert grid.values.shape == (height, width)
    assert {(row + i, column + j): grid.values[i, j] for i, j in np.argwhere(grid.values)} == kept
    places = np.array(list(kept)) - (row, column)
    assert grid.take_changes() == (*np.sort(places[:, 0])[[0, -1]], *np.sort(places[:, 1])[[0, -1]])
    assert grid.take_changes() is None
    assert grid.origin == (1.0 + column * 0.5, -2.0 + row * 0.5)


def test_what_is_allocated_is_not_moved():
    grid = Blocks()
    grid.cover(-3, 5, 2, 4)
    values = grid.values
    grid.cover(-8, 8, 0, 8)
    assert grid.values is values


def test_a_grid_beyond_reason_is_refused_and_stays_as_it_was():
    grid = Numbers()
    grid.cover(0, 3, 0, 3)
    with pytest.raises(MappingError, match="check the robot's pose"):
        grid.cover(0, 10, 0, 100_000)
    assert (grid.shape, grid.values.shape) == ((3, 3), (3, 3))

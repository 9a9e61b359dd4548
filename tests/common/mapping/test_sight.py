from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, OUTSIDE, blocker
from tests.common.mapping.reference import touched_cells

SIDE = 12
# Points on cell corners, on borders, in the middle and anywhere.
COORDINATE = st.one_of(
    st.integers(1, SIDE).map(lambda k: k * SUBCELLS),
    st.integers(1, SIDE - 1).map(lambda k: k * SUBCELLS + SUBCELLS // 2),
    st.integers(SUBCELLS, SIDE * SUBCELLS),
)


def grid() -> np.ndarray:
    cells = np.full((SIDE + 2, SIDE + 2), OUTSIDE, dtype=np.int8)
    cells[1:-1, 1:-1] = FREE
    return cells


@settings(max_examples=150, deadline=None, derandomize=True)
@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE)
def test_exactly_the_touched_cells_block(x0, y0, x1, y1):
    cells = grid()
    width = cells.shape[1]
    touched = touched_cells((x0, y0), (x1, y1))
    for row, column in np.ndindex(cells.shape):
        if cells[row, column] == OUTSIDE:
            continue
        cells[row, column] = OCCUPIED
        found = blocker(cells.reshape(-1), width, x0, y0, x1, y1)
        back = blocker(cells.reshape(-1), width, x1, y1, x0, y0)
        cells[row, column] = FREE
        outside = any(cells[r, c] == OUTSIDE for r, c in touched)
        if (row, column) in touched:
            assert found != CLEAR
            assert back != CLEAR
        elif not outside:
            assert found == CLEAR
            assert back == CLEAR


@settings(max_examples=200, deadline=None, derandomize=True)
@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE, st.integers(0, 2**32 - 1))
def test_the_answer_names_a_touched_cell_that_is_not_free(x0, y0, x1, y1, seed):
    cells = grid()
    cells[1:-1, 1:-1] = np.random.default_rng(seed).choice([FREE] * 6 + [OCCUPIED, -1], (SIDE, SIDE))
    width = cells.shape[1]
    found = blocker(cells.reshape(-1), width, x0, y0, x1, y1)
    blocked = [cell for cell in touched_cells((x0, y0), (x1, y1)) if cells[cell] != FREE]
    assert (found == CLEAR) == (not blocked)
    if blocked:
        assert divmod(found, width) in blocked

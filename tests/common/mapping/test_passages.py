"""Where a robot could drive on into the unknown, and where only a beam went through."""

from __future__ import annotations

import numpy as np
import pytest

from common.mapping.clearance import near_spans
from common.mapping.passages import count_wall, update_passages


@pytest.mark.parametrize(("gap", "radius", "opens"), [(1, 1.0, False), (2, 1.5, False), (3, 1.0, True), (5, 2.5, True)])
def test_a_hole_in_a_wall_is_a_passage_when_the_robot_fits(gap: int, radius: float, opens: bool) -> None:
    cells = np.full((12, 21), -1, dtype=np.int8)
    cells[1:6, 1:-1] = 0
    cells[6, 1:-1] = 100
    cells[6, 8 : 8 + gap] = -1
    passages = np.zeros(cells.shape, dtype=np.bool_)
    crowd, spans = np.zeros(cells.shape, dtype=np.int32), near_spans(radius, 0.5)
    for row, column in np.argwhere(cells == 100):
        count_wall(crowd, row, column, spans, 1)
    update_passages(cells, passages, crowd, len(spans) // 2, (0, 11, 0, 20))
    assert passages[5, 8 : 8 + gap].any() == opens
    assert not passages[1:6, 13:-2][1:-1].any()

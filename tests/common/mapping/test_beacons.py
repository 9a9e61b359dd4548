import numpy as np
import pytest

from common.mapping.beacons import nearest_in_line
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, blocker

WIDTH = 60


@pytest.mark.parametrize("seed", range(30))
def test_the_nearest_in_line_are_those_of_a_search_by_sorting(seed):
    rng = np.random.default_rng(seed)
    cells = (rng.random(WIDTH * WIDTH) < 0.03).astype(np.int8)
    count, most, reach = int(rng.integers(0, 80)), int(rng.integers(1, 20)), int(rng.integers(1, 40)) * SUBCELLS
    # On whole cells many are equally far: then those of the lower numbers count.
    x, y = (rng.integers(1, WIDTH - 1, (2, count)) * SUBCELLS).astype(np.int64)
    here = WIDTH // 2 * SUBCELLS
    far = (x - here) ** 2 + (y - here) ** 2
    seen = [
        node
        for node in range(count)
        if far[node] <= reach * reach and blocker(cells, WIDTH, here, here, x[node], y[node]) == CLEAR
    ]
    expected = sorted(sorted(seen, key=lambda node: far[node])[:most])
    assert nearest_in_line(cells, WIDTH, x, y, here, here, reach, most).tolist() == expected

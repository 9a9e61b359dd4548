import numpy as np
from hypothesis import given, settings

from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, ObservationBatch
from common.observation_index import neighbour_table
from tests.observations import observations


def reference(batch: ObservationBatch) -> np.ndarray:
    table = np.full((len(batch.edges), NEIGHBOUR_COUNT), -1, dtype=np.int32)
    first = 0
    for n in batch.count:
        rows = {tuple(offset): first + i for i, offset in enumerate(batch.offsets[first : first + n].tolist())}
        for (x, y), row in rows.items():
            for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS.tolist()):
                if batch.edges[row] >> k & 1:
                    table[row, k] = rows.get((x + dx, y + dy), -1)
        first += n
    return table


@given(observations(), observations())
@settings(max_examples=60, deadline=None)
def test_rows_of_neighbours_are_global(one, other):
    batch = ObservationBatch.stack([one, other, one])
    table = neighbour_table(batch.count, batch.offsets, batch.edges)
    np.testing.assert_array_equal(table, reference(batch))


def test_an_edge_to_nowhere_gives_minus_one():
    offsets = np.array([[0, 0], [32767, 0]], dtype=np.int16)
    edges = np.full(2, (1 << NEIGHBOUR_COUNT) - 1, dtype=np.uint32)
    assert (neighbour_table(np.array([2], dtype=np.int32), offsets, edges) == -1).all()

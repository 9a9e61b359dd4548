from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.planners.navigation.indexed_heap import less, remove, settle

VERTICES = 12
KEYS = st.tuples(st.integers(0, 5), st.integers(0, 5))


@settings(max_examples=50)
@given(steps=st.lists(st.tuples(st.integers(0, VERTICES - 1), st.none() | KEYS), max_size=60))
def test_the_smallest_key_is_first_whatever_is_put_in_moved_and_removed(
    steps: list[tuple[int, tuple[int, int] | None]],
) -> None:
    keys = np.zeros((VERTICES, 2), dtype=np.int64)
    nodes = np.zeros(VERTICES, dtype=np.int32)
    where = np.full(VERTICES, -1, dtype=np.int32)
    size, expected = 0, dict[int, tuple[int, int]]()
    for vertex, key in steps:
        node = np.int32(vertex)
        if key is None:
            if expected.pop(vertex, None) is not None:
                size = remove(keys, nodes, where, size, node)
        else:
            place = size if vertex not in expected else int(where[vertex])
            size += vertex not in expected
            settle(keys, nodes, where, size, place, np.array(key), node)
            expected[vertex] = key
        assert {int(nodes[place]): tuple(keys[place].tolist()) for place in range(size)} == expected
        assert np.flatnonzero(where >= 0).tolist() == sorted(expected)
        assert all(nodes[where[each]] == each for each in expected)
        assert not any(less(keys[place], keys[0]) for place in range(size))

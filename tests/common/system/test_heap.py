"""The heap gives back what went in, smallest first."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.system.heap import pop, push


@given(st.lists(st.floats(0.0, 1e6), max_size=60), st.integers(0, 60))
def test_items_come_out_in_order_of_their_keys(given_keys, early):
    keys, items = np.empty(61), np.empty(61, dtype=np.int64)
    size = 0
    waiting = []
    for number, key in enumerate(given_keys):
        size = push(keys, items, size, key, number)
        waiting.append(key)
        if number == early:
            assert given_keys[items[0]] == min(waiting)
            waiting.remove(given_keys[items[0]])
            size = pop(keys, items, size)
    out = []
    while size:
        out.append(given_keys[items[0]])
        size = pop(keys, items, size)
    assert out == sorted(waiting)

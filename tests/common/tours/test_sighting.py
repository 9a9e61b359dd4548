import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.tours.sighting import add_seen, count_bits, pack_rows, remove_seen, set_of

ROWS = st.lists(st.sets(st.integers(0, 199)), min_size=1, max_size=8)


def members(words):
    return {64 * t + bit for t, word in enumerate(words) for bit in range(64) if int(word) >> bit & 1}


@settings(deadline=None, max_examples=50)
@given(ROWS, st.integers(0, 2**32 - 1))
def test_packed_rows_hold_what_the_viewpoints_see(rows, seed):
    rng = np.random.default_rng(seed)
    # Some items have no number; the others are numbered in any order.
    numbers = np.full(200, -1, dtype=np.int64)
    kept = np.flatnonzero(rng.random(200) < 0.7)
    numbers[kept] = rng.permutation(len(kept))
    pointer = np.cumsum([0, *map(len, rows)])
    items = np.array([item for row in rows for item in sorted(row)], dtype=np.int32)
    chosen = rng.permutation(len(rows))[: 1 + len(rows) // 2]
    sight = pack_rows(pointer, items, chosen, numbers)
    assert len(sight.pointer) == len(chosen) + 1
    for place, row in enumerate(chosen):
        words = np.zeros(sight.tiles, dtype=np.uint64)
        add_seen(sight.pointer, sight.tile, sight.mask, np.array([place]), words)
        expected = {int(numbers[item]) for item in rows[row]} - {-1}
        assert members(words) == expected
        assert count_bits(words) == len(expected)
        # Each tile is listed once, and never without a cell.
        entries = slice(sight.pointer[place], sight.pointer[place + 1])
        assert len(set(sight.tile[entries].tolist())) == len(sight.tile[entries])
        assert (sight.mask[entries] > 0).all()
    words = set_of(np.arange(len(kept)), sight.tiles)
    assert count_bits(words) == len(kept)
    remove_seen(sight.pointer, sight.tile, sight.mask, np.arange(len(chosen)), words)
    seen = {int(numbers[item]) for row in chosen for item in rows[row]}
    assert members(words) == set(range(len(kept))) - seen


def test_a_set_is_made_of_its_numbers():
    words = set_of(np.array([0, 5, 63, 64, 130]), 3)
    assert words.dtype == np.uint64
    assert members(words) == {0, 5, 63, 64, 130}
    assert members(set_of(np.empty(0, dtype=np.int64), 2)) == set()

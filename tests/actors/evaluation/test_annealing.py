"""Tours over a star: a hub with spokes of known lengths, each of which ends in a room that only its end sees."""

import numpy as np
import pytest

from actors.evaluation.annealing import MAX_STOPS, anneal, drive

CELLS = 50


def star(spokes):
    """Distances, hops, visibility rows and missing words; node 0 is the hub, node k + 1 the end of spoke k."""
    n = len(spokes) + 1
    out = np.array([0.0, *spokes])
    distances = (out[:, None] + out[None, :]).astype(np.float32)
    np.fill_diagonal(distances, 0.0)
    hops = np.zeros((n, n), dtype=np.int32)
    hops[0] = np.arange(n)
    np.fill_diagonal(hops, -1)
    pointer = np.maximum(np.arange(-1, n), 0).astype(np.int64)
    missing = np.full(n - 1, (1 << CELLS) - 1, dtype=np.uint64)
    sight = (pointer, np.arange(n - 1, dtype=np.int32), missing.copy())
    return sight, distances, hops, missing


def annealed(spokes, order, penalty, tolerance=0):
    sight, distances, hops, missing = star(spokes)
    ends = np.arange(1, len(distances), dtype=np.int64)
    near = np.tile(ends, (len(distances), 1))
    return anneal(
        *sight, distances, hops, 0, np.array(order, dtype=np.int64), missing, CELLS * len(missing), tolerance, ends,
        near, 20_000, 8.0, 0.3, penalty, 1,
    )  # fmt: skip


def test_the_longest_way_comes_last():
    stops, length, finished = annealed([14.0, 9.0, 5.0, 8.0, 6.0], [1, 2, 3, 4, 5], penalty=2.0)
    assert set(stops.tolist()) == {1, 2, 3, 4, 5}
    assert stops[-1] == 1
    assert length == pytest.approx(2 * 42.0 - 14.0)
    assert finished


def test_a_penalty_that_is_too_small_is_told():
    # A room of 50 cells counts a metre, and the way there and back 10 m and more.
    stops, length, finished = annealed([14.0, 9.0, 5.0, 8.0, 6.0], [1, 2, 3, 4, 5], penalty=0.02)
    assert not finished
    assert sorted(stops.tolist()) == [1, 2, 3, 4, 5]
    assert length <= 2 * 42.0 - 6.0


def test_what_may_stay_unseen_does():
    stops, length, _ = annealed([14.0, 9.0, 5.0], [1, 2, 3], penalty=2.0, tolerance=CELLS)
    assert sorted(stops.tolist()) == [2, 3]
    assert length == pytest.approx(5.0 + 5.0 + 9.0)


def test_large_worlds_have_room_for_all_their_stops():
    spokes = [3.0] * (MAX_STOPS + 44)
    stops, length, _ = annealed(spokes, range(1, len(spokes) + 1), penalty=2.0)
    assert len(stops) == len(spokes)
    assert length == pytest.approx(6.0 * len(spokes) - 3.0)


def test_driving_ends_when_enough_is_seen_and_is_given_up_beyond_a_bound():
    sight, distances, hops, missing = star([4.0, 2.0, 3.0])
    stops = np.array([1, 2, 3], dtype=np.int64)
    rest, passed = np.empty_like(missing), np.zeros(4, dtype=np.int64)

    def driven(tolerance, bound, stamp):
        return drive(
            *sight, distances, hops, 0, stops, 3, missing, 3 * CELLS, tolerance, 0.5, bound, rest, passed, stamp
        )

    assert driven(0, np.inf, 1) == (4.0 + 6.0 + 5.0, 3, True)
    assert driven(CELLS, np.inf, 2) == (4.0 + 6.0, 2, True)
    assert driven(0, 12.0, 3)[0] == np.inf
    stops[2] = 2
    length, _, seen = driven(0, np.inf, 4)
    assert not seen
    assert length == pytest.approx(10.0 + 4.0 + 0.5 * CELLS)

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.expert import cover
from actors.expert.tour import tour_length
from actors.expert.visibility import Visibility, fill_words


def universe(seed, viewpoints=25, rows=20, columns=26):
    """A random open plane with pillars: who sees what, distances, and all cells that somebody sees."""
    rng = np.random.default_rng(seed)
    free = rng.random((rows, columns)) < 0.93
    cells = np.argwhere(free)
    chosen = cells[rng.choice(len(cells), viewpoints, replace=False)]
    points = np.ascontiguousarray(chosen[:, ::-1] + 0.5)
    sight = Visibility.build(free, points, 6.0, 240)
    distances = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)).astype(np.float32)
    missing = np.zeros(sight.tiles, dtype=np.uint64)
    for k in range(len(sight.tile)):
        missing[sight.tile[k]] |= sight.mask[k]
    return free, points, sight, distances, missing


def uncovered(sight, missing, stops):
    rest = missing.copy()
    for v in stops:
        for k in range(sight.pointer[v], sight.pointer[v + 1]):
            rest[sight.tile[k]] &= ~sight.mask[k]
    return sum(int(word).bit_count() for word in rest)


def test_a_viewpoint_sees_its_disc_and_not_behind_walls():
    free = np.ones((20, 20), dtype=np.bool_)
    free[:, 12] = False
    sight = Visibility.build(free, np.array([[8.0, 8.0]]), 6.0, 720)
    seen = np.zeros(free.shape, dtype=np.bool_)
    for k in range(len(sight.tile)):
        row, column = divmod(int(sight.tile[k]), 3)
        for bit in range(64):
            if int(sight.mask[k]) >> bit & 1:
                seen[row * 8 + bit // 8, column * 8 + bit % 8] = True
    y, x = np.mgrid[:20, :20] + 0.5
    distance = np.hypot(x - 8.0, y - 8.0)
    assert seen[(distance < 5.2) & (x < 12)].all()
    assert not seen[distance > 6.8].any()
    assert not seen[:, 12:].any()


def test_words_hold_exactly_the_cells():
    cells = np.array([0, 7, 8, 25, 26 * 9 + 3], dtype=np.int64)
    words = np.full(16, 5, dtype=np.uint64)
    fill_words(cells, 26, words)
    assert sum(int(word).bit_count() for word in words) == len(cells)
    assert int(words[0]) == 0b10000001
    assert int(words[4]) == 1 << (8 + 3)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_a_planned_tour_covers_to_the_tolerance_and_improving_never_lengthens(seed, tolerance):
    _, points, sight, distances, missing = universe(seed)
    allowed = np.ones(len(points), dtype=np.bool_)
    allowed[0] = False
    gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
    attainable = uncovered(sight, missing, np.flatnonzero(allowed))
    arguments = (sight.pointer, sight.tile, sight.mask, missing, allowed, distances, 0)
    none = np.zeros(0, dtype=np.int64)
    rough = cover.plan_cover(*arguments, gains.copy(), np.ones(len(gains)), none, tolerance, 0)
    fine = cover.plan_cover(*arguments, gains.copy(), np.ones(len(gains)), none, tolerance, 6)
    for stops in (rough, fine):
        assert 0 not in stops
        assert uncovered(sight, missing, stops) <= max(tolerance, attainable)
    assert tour_length(distances, 0, fine) <= tour_length(distances, 0, rough) + 1e-2


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_every_priced_choice_still_covers(seed, tolerance):
    _, points, sight, distances, missing = universe(seed)
    allowed = np.ones(len(points), dtype=np.bool_)
    gains = cover.count_gains(sight.pointer, sight.tile, sight.mask, missing, allowed)
    none = np.zeros(0, dtype=np.int64)
    arguments = (sight.pointer, sight.tile, sight.mask, missing, allowed, distances)
    stops = cover.plan_cover(*arguments, 0, gains, np.ones(len(gains)), none, tolerance, 4)
    choices = np.array([1, 2, -1, 5, int(stops[0])], dtype=np.int64)
    orders = np.zeros((5, len(stops)), dtype=np.int64)
    sizes = np.zeros(5, dtype=np.int64)
    lengths = cover.price_choices(*arguments, stops, choices, tolerance, orders, sizes)
    assert np.isinf(lengths[2])
    for c in (0, 1, 3, 4):
        route = orders[c, : sizes[c]]
        assert uncovered(sight, missing, [choices[c], *route]) <= tolerance
        assert lengths[c] == np.float32(0) or np.isclose(
            lengths[c], tour_length(distances, choices[c], route), atol=1e-3
        )
    assert stops[0] not in orders[4, : sizes[4]]

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.planners.navigation.graph_search import NO_WAY, a_star, find_place, straight_length
from tests.common.planners.places import Places, length_of, shortest

FAR = (1 << 30) - 1


@given(dx=st.integers(-FAR, FAR), dy=st.integers(-FAR, FAR))
def test_straight_lengths_are_exact_ceilings(dx: int, dy: int) -> None:
    length = int(straight_length(dx, dy))
    square = dx * dx + dy * dy
    assert length * length >= square
    assert length == 0 or (length - 1) * (length - 1) < square


@given(
    points=st.lists(
        st.tuples(st.integers(-FAR // 2, FAR // 2), st.integers(-FAR // 2, FAR // 2)), min_size=3, max_size=3
    )
)
def test_straight_lengths_obey_the_triangle_inequality(points: list[tuple[int, int]]) -> None:
    a, b, c = points
    direct = straight_length(a[0] - c[0], a[1] - c[1])
    assert direct <= straight_length(a[0] - b[0], a[1] - b[1]) + straight_length(b[0] - c[0], b[1] - c[1])


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    joined=st.sampled_from([0.0, 0.05, 0.15, 0.4, 1.0]),
)
def test_a_star_finds_what_dijkstra_finds(seed: int, count: int, joined: float) -> None:
    places = Places(seed, count, joined)
    graph = places.graph()
    start = int(places.random.integers(count))
    length, path, expanded = a_star(graph, start)
    assert length == shortest(graph, start)
    assert bool(path) == (length < NO_WAY)
    if path:
        assert path[0] == start
        assert length_of(graph, path) == length
        assert expanded >= len(path)


def test_places_are_found_where_they_are_and_nowhere_else() -> None:
    graph = Places(3, 30, 0.1).graph()
    for k, (x, y) in enumerate(zip(graph.x.tolist(), graph.y.tolist(), strict=True)):
        assert find_place(graph.x, graph.y, x, y) == k
        assert find_place(graph.x, graph.y, x + 1, y) == -1
    nothing = np.zeros(0, dtype=np.int64)
    assert find_place(nothing, nothing, 0, 0) == -1

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.planners.navigation.graph_search import NO_WAY, a_star
from common.planners.navigation.incremental_search import IncrementalSearch
from tests.common.planners.places import Places, length_of, straight


def check(places: Places, search: IncrementalSearch, here: tuple[int, int]) -> list[tuple[int, int]]:
    """Compare with a fresh search; return the places of the path."""
    graph = places.graph()
    start = places.places.index(here)
    repaired = search.replan(graph, start)
    fresh, path, _ = a_star(graph, start)
    assert repaired == fresh
    ways = (path, search.path())
    for way in ways:
        assert bool(way) == (fresh < NO_WAY)
        if way:
            assert way[0] == start
            assert length_of(graph, way) == fresh
    return [places.places[node] for node in ways[1]]


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    joined=st.sampled_from([0.0, 0.05, 0.1, 0.2, 0.5]),
    changes=st.lists(
        st.tuples(st.integers(0, 20), st.integers(0, 3), st.integers(0, 3)),
        min_size=1,
        max_size=12,
    ),
    jumps=st.booleans(),
)
def test_repairing_gives_what_a_fresh_search_gives_after_every_change(
    seed: int, count: int, joined: float, changes: list[tuple[int, int, int]], jumps: bool
) -> None:
    """Edges change, places come and go, and the robot moves along its path or, taken by the wind, anywhere."""
    places = Places(seed, count, joined)
    search = IncrementalSearch()
    here = places.places[0]
    for edges, come, go in changes:
        path = check(places, search, here)
        if len(path) > 1:
            here = path[1]
        if jumps and places.random.random() < 0.3:
            here = places.places[int(places.random.integers(len(places.places)))]
        places.change(edges)
        for _ in range(come):
            places.come(joined)
        for _ in range(min(go, len(places.places) - 1)):
            gone = places.places[int(places.random.integers(len(places.places)))]
            places.go(gone)
            if gone == here:
                here = places.places[0]
    check(places, search, here)


def field(side: int, seed: int, joined: float) -> Places:
    """A square of places, each joined with its four neighbours by chance; the goal is tied to the first of them."""
    places = Places(seed, 0, 0.0)
    step = 1 << 16
    places.places = [(step * i, step * j) for j in range(side) for i in range(side)]
    for x, y in places.places:
        for other in ((x + step, y), (x, y + step)):
            if other in places.places and places.random.random() < joined:
                places.edges[frozenset(((x, y), other))] = step
    places.goal = (0, 0)
    places.legs = {(0, 0): 0}
    return places


def test_one_blocked_edge_far_from_the_path_costs_no_expansion() -> None:
    places = field(20, 1, 1.0)
    step = 1 << 16
    search = IncrementalSearch()
    path = check(places, search, (2 * step, 0))
    before = search.expanded
    del places.edges[frozenset(((15 * step, 15 * step), (16 * step, 15 * step)))]
    check(places, search, path[1])
    assert search.expanded == before


def test_a_place_far_from_the_path_that_goes_costs_no_expansion() -> None:
    places = field(20, 1, 1.0)
    step = 1 << 16
    search = IncrementalSearch()
    path = check(places, search, (2 * step, 0))
    before = search.expanded
    places.go((15 * step, 15 * step))
    check(places, search, path[1])
    assert search.expanded == before


def test_repairing_expands_fewer_vertices_than_searching_anew() -> None:
    places = field(30, 2, 0.9)
    search = IncrementalSearch()
    here = places.places[-1]
    fresh = repaired = 0
    path = check(places, search, here)
    for _ in range(20):
        here = path[1] if len(path) > 1 else here
        # What a robot learns lies around it.
        for pair in [pair for pair in places.edges if all(straight(place, here) < 4 << 16 for place in pair)]:
            if places.random.random() < 0.1:
                del places.edges[pair]
        before = search.expanded
        path = check(places, search, here)
        repaired += search.expanded - before
        anew = IncrementalSearch()
        anew.replan(places.graph(), places.places.index(here))
        fresh += anew.expanded
    assert repaired < 0.7 * fresh


def test_without_edges_there_is_no_way() -> None:
    places = field(3, 0, 0.0)
    search = IncrementalSearch()
    assert search.path() == []
    assert check(places, search, places.places[5]) == []
    assert check(places, search, (0, 0)) == [(0, 0)]
    assert np.array_equal(places.graph().goal_costs[1:], np.full(8, NO_WAY))

"""Random graphs of places that come, go and are joined at random, and what is true of paths over them."""

from __future__ import annotations

import heapq
import itertools
from math import isqrt

import numpy as np

from common.planners.navigation.graph_search import NO_WAY, GoalGraph

SPAN = 1 << 20


def straight(a: tuple[int, int], b: tuple[int, int]) -> int:
    """Length of a straight line, rounded up."""
    square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
    root = isqrt(square)
    return root + (root * root < square)


class Places:
    """Places in a plane, some pairs of which are joined, straight or by a way that is longer."""

    def __init__(self, seed: int, count: int, joined: float) -> None:
        self.random = np.random.default_rng(seed)
        self.goal = self._anywhere()
        self.edges: dict[frozenset[tuple[int, int]], int] = {}
        self.legs: dict[tuple[int, int], int] = {}
        self.places: list[tuple[int, int]] = []
        for _ in range(count):
            self.come(joined)

    def come(self, joined: float) -> None:
        """Add a place, joined with each other one by chance."""
        place = self._anywhere()
        while place in self.places:
            place = self._anywhere()
        for other in self.places:
            if self.random.random() < joined:
                self.edges[frozenset((place, other))] = self._length(place, other)
        self.places.append(place)
        if self.random.random() < 0.2:
            self.legs[place] = self._length(place, self.goal)

    def go(self, place: tuple[int, int]) -> None:
        """Take a place away."""
        self.places.remove(place)
        self.edges = {pair: length for pair, length in self.edges.items() if place not in pair}
        self.legs.pop(place, None)

    def change(self, count: int) -> None:
        """Take away, add or lengthen so many edges, and now and then a last leg."""
        if len(self.places) < 2:
            return
        for _ in range(count):
            a, b = (self.places[k] for k in self.random.choice(len(self.places), 2, replace=False))
            if frozenset((a, b)) in self.edges and self.random.random() < 0.6:
                del self.edges[frozenset((a, b))]
            else:
                self.edges[frozenset((a, b))] = self._length(a, b)
        if self.random.random() < 0.3:
            place = self.places[int(self.random.integers(len(self.places)))]
            if self.legs.pop(place, None) is None:
                self.legs[place] = self._length(place, self.goal)

    def graph(self) -> GoalGraph:
        """Return the graph as it is now."""
        self.places.sort(key=lambda place: (place[1], place[0]))
        numbers = {place: k for k, place in enumerate(self.places)}
        rows: list[dict[int, int]] = [{} for _ in self.places]
        for pair, length in self.edges.items():
            a, b = (numbers[place] for place in pair)
            rows[a][b] = rows[b][a] = length
        return GoalGraph(
            x=np.array([x for x, _ in self.places], dtype=np.int64),
            y=np.array([y for _, y in self.places], dtype=np.int64),
            pointer=np.cumsum([0, *(len(row) for row in rows)], dtype=np.int64),
            neighbours=np.array([b for row in rows for b in sorted(row)], dtype=np.int32),
            costs=np.array([row[b] for row in rows for b in sorted(row)], dtype=np.int64),
            goal_costs=np.array([self.legs.get(place, NO_WAY) for place in self.places], dtype=np.int64),
            heuristic=np.array([straight(place, self.goal) for place in self.places], dtype=np.int64),
        )

    def _anywhere(self) -> tuple[int, int]:
        # Few different coordinates, so that many sums of lengths are equal.
        x, y = (self.random.integers(-8, 8, 2) * (SPAN // 16)).tolist()
        if self.random.random() < 0.3:
            x += int(self.random.integers(SPAN // 32))
        return x, y

    def _length(self, a: tuple[int, int], b: tuple[int, int]) -> int:
        return straight(a, b) + (int(self.random.integers(SPAN)) if self.random.random() < 0.2 else 0)


def shortest(graph: GoalGraph, start: int) -> int:
    """Dijkstra's algorithm, as plainly as can be."""
    best = {start: 0}
    heap = [(0, start)]
    while heap:
        length, node = heapq.heappop(heap)
        if length > best[node]:
            continue
        for k in range(int(graph.pointer[node]), int(graph.pointer[node + 1])):
            there, further = int(graph.neighbours[k]), length + int(graph.costs[k])
            if further < best.get(there, NO_WAY):
                best[there] = further
                heapq.heappush(heap, (further, there))
    return min([NO_WAY, *(length + int(graph.goal_costs[node]) for node, length in best.items())])


def length_of(graph: GoalGraph, path: list[int]) -> int:
    """Walk a path, each edge of which must be there."""
    total = 0
    for a, b in itertools.pairwise(path):
        row = slice(int(graph.pointer[a]), int(graph.pointer[a + 1]))
        place = np.flatnonzero(graph.neighbours[row] == b)
        assert len(place) == 1
        total += int(graph.costs[row][place[0]])
    return total + int(graph.goal_costs[path[-1]])

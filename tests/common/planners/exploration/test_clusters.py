"""Clusters of frontier cells."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.planners.exploration.clusters import cluster_labels, openings


def _plain_labels(cells: list[tuple[int, int]]) -> list[set[tuple[int, int]]]:
    left, clusters = set(cells), []
    while left:
        cluster, edge = set(), {left.pop()}
        while edge:
            cluster |= edge
            edge = {(x + i, y + j) for x, y in edge for i in (-1, 0, 1) for j in (-1, 0, 1)} & left
            left -= edge
        clusters.append(cluster)
    return clusters


@settings(deadline=None, max_examples=50)
@given(st.sets(st.tuples(st.integers(0, 11), st.integers(0, 7)), min_size=1))
def test_labels_part_cells_into_what_eight_neighbours_connect(chosen: set[tuple[int, int]]) -> None:
    cells = sorted(chosen, key=lambda cell: cell[::-1])
    # With a margin of one cell to either side, as the padded grid has it.
    labels = cluster_labels(np.array([14 * y + x + 1 for x, y in cells]), 14).tolist()
    found: dict[int, set[tuple[int, int]]] = {}
    for cell, number in zip(cells, labels, strict=True):
        found.setdefault(number, set()).add(cell)
    assert sorted(found) == list(range(len(found)))
    assert sorted(map(sorted, found.values())) == sorted(map(sorted, _plain_labels(cells)))


def test_no_frontiers_have_no_labels() -> None:
    assert len(cluster_labels(np.empty(0, dtype=np.int64), 14)) == 0


def test_openings_are_clusters_of_some_length_on_a_hundred_square_metres() -> None:
    sizes = np.array([3, 6, 40, 5])
    assert openings(sizes, 0.25, 200.0) == 1.0
    assert openings(sizes, 0.1, 200.0) == 0.5
    assert openings(np.array([], dtype=np.int64), 0.25, 50.0) == 0.0

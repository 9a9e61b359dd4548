"""Shortest paths by Floyd and Warshall: slow, and simple enough to be the yardstick of the kernels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from common.observations.index import NeighbourTable
from common.observations.observation import ObservationBatch


def edge_lengths(batch: ObservationBatch, table: NeighbourTable, graph: int) -> NDArray[np.float64]:
    """Return the lengths of the edges of one observation, inf without one, shape (nodes, nodes)."""
    first, last = int(table.node_ptr[graph]), int(table.node_ptr[graph + 1])
    lengths = np.full((last - first, last - first), np.inf)
    for row in range(first, last):
        for slot, other in enumerate(table.rows[row]):
            if other >= 0:
                lengths[row - first, other - first] = min(table.lengths[row, slot], lengths[row - first, other - first])
    np.fill_diagonal(lengths, 0.0)
    return lengths


def all_path_lengths(batch: ObservationBatch, table: NeighbourTable) -> Iterator[NDArray[np.float64]]:
    """Yield the lengths of each observation's shortest paths, none through a target, shape (nodes, nodes)."""
    for graph in range(len(batch)):
        between = edge_lengths(batch, table, graph)
        target = len(between) - 1 if batch.has_target[graph] else -1
        for middle in range(len(between)):
            if middle != target:
                between = np.minimum(between, between[:, middle, None] + between[None, middle])
        yield between

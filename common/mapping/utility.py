"""Utility: how many frontiers each viewpoint observes, brought up to date where that can have changed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.mapping.belief import Belief
from common.mapping.frontiers import FrontierChanges, Frontiers
from common.mapping.raycast import SUBCELLS
from common.mapping.sight_pairs import IN_SIGHT, Pairs, copy_pairs, room_for, update_sight
from common.mapping.thinning import Blocks, block_at, blocks_of
from common.mapping.viewpoints import ViewpointGraph
from common.system.jit import njit


@njit(cache=True, nogil=True)
def _most_pairs(pieces: Any, first_of: NDArray[np.int32], rows: int, columns: int, side: int) -> int:
    """Return the largest number of viewpoints in a window of ``side`` by ``side`` squares (a summed-area table)."""
    sums = np.zeros((rows + 1, columns + 1), dtype=np.int32)
    for j in range(rows):
        for i in range(columns):
            count = 0
            piece = first_of[j * columns + i]
            while piece >= 0:
                count += pieces[piece].exists
                piece = pieces[piece].next
            sums[j + 1, i + 1] = count + sums[j, i + 1] + sums[j + 1, i] - sums[j, i]
    most = 0
    for j in range(rows):
        top = min(j + side, rows)
        for i in range(columns):
            right = min(i + side, columns)
            most = max(most, sums[top, right] - sums[j, right] - sums[top, i] + sums[j, i])
    return most


@njit(cache=True, nogil=True)
def _sightings(
    frontiers: NDArray[np.int64],
    numbers: NDArray[np.int32],
    nodes: int,
    counts: NDArray[np.int32],
    width: int,
    blocks: Blocks,
    slots: NDArray[np.int32],
    pairs: Pairs,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """List the pairs in sight by node; see `FrontierUtility.sightings`."""
    # The counts tell how much room the rows take at most: they count frontiers that others stand for, too.
    begin = np.zeros(nodes + 1, dtype=np.int64)
    for piece in range(len(numbers)):
        if numbers[piece] >= 0:
            begin[numbers[piece] + 1] = counts[piece]
    for node in range(nodes):
        begin[node + 1] += begin[node]
    end = begin[:nodes].copy()
    seen = np.empty(begin[nodes], dtype=np.int32)
    for f in range(len(frontiers)):
        slot = slots[block_at(blocks, frontiers[f], width)]
        if pairs.cell[slot] != frontiers[f]:
            continue
        for k in range(pairs.filled[slot]):
            if pairs.state[slot, k] == IN_SIGHT:
                node = numbers[pairs.piece[slot, k]]
                if node >= 0:
                    seen[end[node]] = f
                    end[node] += 1
    size = 0
    for node in range(nodes):
        first = begin[node]
        begin[node] = size
        for k in range(first, end[node]):
            seen[size] = seen[k]
            size += 1
    begin[nodes] = size
    return begin, seen[:size]


@njit(cache=True, nogil=True)
def _overlooked(
    numbers: NDArray[np.int32], pieces: Any, pairs: Pairs, used: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the frontiers that no viewpoint shows; see `FrontierUtility.overlooked`."""
    shows = np.zeros(len(pieces), dtype=np.bool_)
    for piece in range(len(pieces)):
        shows[piece] = numbers[piece] >= 0 and not pieces[piece].visited
    found, weight = np.empty(used, dtype=np.int32), np.empty(used, dtype=np.int32)
    size = 0
    for slot in range(used):
        shown = False
        for k in range(pairs.filled[slot]):
            if pairs.state[slot, k] == IN_SIGHT and shows[pairs.piece[slot, k]]:
                shown = True
                break
        if not shown:
            found[size], weight[size] = pairs.cell[slot], pairs.weight[slot]
            size += 1
    return found[:size], weight[:size]


class FrontierUtility:
    """How many frontiers each viewpoint observes, for one generation of the belief.

    Attributes:
        counts: frontiers in range and in line of sight of each piece's viewpoint, int32; void where it has none.
        side: of the blocks of which one frontier cell stands for all, cells.
    """

    def __init__(
        self, belief: Belief, frontiers: Frontiers, graph: ViewpointGraph, config: MappingConfig, *, side: int
    ) -> None:
        """Know of no frontier yet.

        Args:
            belief: its grid as it is allocated now.
            frontiers: of the same generation.
            graph: likewise.
            config: ranges and spacing.
            side: of the blocks, cells; 1 looks at each frontier cell.
        """
        self._graph = graph
        self._mask = frontiers.padded_mask.reshape(-1)
        self._width = belief.padded.shape[1]
        self.side = side
        self._blocks = blocks_of(belief, side)
        self._reach = round(config.observable_range / belief.resolution * SUBCELLS)
        # Squares that can hold viewpoints in range of one cell, in a row.
        self._squares = int(2 * config.observable_range / config.viewpoint_spacing) + 3
        self.counts = np.zeros(graph.used, dtype=np.int32)
        self._slots = np.full(self._blocks.rows * self._blocks.columns, -1, dtype=np.int32)
        self._listed = np.zeros(len(self._slots), dtype=np.bool_)
        self._used = 0
        self._pairs = room_for(0, 64)

    def update(self, cells: NDArray[np.int8], frontiers: FrontierChanges) -> None:
        """Bring the counts up to date; the graph must be so already.

        Args:
            cells: padded grid, flat, int8.
            frontiers: what became of the frontiers since the last update.
        """
        graph = self._graph
        if graph.changed[1] < 0 and not len(frontiers.added):
            return
        self._reserve(self._used + len(frontiers.added) + len(frontiers.removed))
        self._used = update_sight(
            cells,
            self._mask,
            self._width,
            self._blocks,
            graph.pieces,
            graph.first_of,
            graph.layout,
            self.counts,
            self._reach,
            self._slots,
            self._listed,
            self._pairs,
            self._used,
            frontiers.added,
            frontiers.removed,
            graph.fresh,
            graph.ended,
            graph.changed,
            frontiers.lost,
        )

    def sightings(
        self, frontiers: NDArray[np.int64], numbers: NDArray[np.int32], nodes: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return which frontiers each node observes, from what the last update knows; nothing is looked at again.

        Of the frontiers of a block only the one that stands for them is listed.

        Args:
            frontiers: flat cells of the padded grid, all of them frontiers, int64, shape (m,).
            numbers: node number of each piece, -1 without one, int32.
            nodes: how many nodes there are.

        Returns:
            The first entry of each node, int64, shape (nodes + 1,), and the entries: places in `frontiers`,
            ascending for each node, int32.
        """
        pointer, seen = _sightings(
            frontiers, numbers, nodes, self.counts, self._width, self._blocks, self._slots, self._pairs
        )
        return pointer, seen

    def overlooked(self, numbers: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the frontiers that no node observes where the robot has not been, in no order.

        Args:
            numbers: node number of each piece, -1 without one, int32.

        Returns:
            Flat cells, and how many frontier cells each stands for, both int32.
        """
        found, weights = _overlooked(numbers, self._graph.pieces, self._pairs, self._used)
        return found, weights

    def _reserve(self, slots: int) -> None:
        """Make room for so many slots, and for the viewpoints in range of one."""
        graph, pairs = self._graph, self._pairs
        if graph.used > len(self.counts):
            self.counts = np.concatenate([self.counts, np.zeros(graph.used - len(self.counts), dtype=np.int32)])
        capacity, width = pairs.piece.shape
        if slots > capacity:
            capacity = max(256, 2 * slots)
        if graph.used > width and (len(graph.fresh) or not self._used):
            most = int(_most_pairs(graph.pieces, graph.first_of, *graph.dirty.shape, self._squares))
            if most > width:
                width = most + most // 2
        if (capacity, width) != pairs.piece.shape:
            self._pairs = room_for(capacity, width)
            copy_pairs(pairs, self._pairs, self._used)

"""Utility: how many frontiers each viewpoint observes, without testing any pair again to no purpose.

Every pair of a frontier and a viewpoint in range is in one of two states: in sight, or blocked by a cell that is
remembered. A blocked pair stays blocked as long as that cell is not free, and a pair in sight stays in sight as long
as no cell was lost, so an update tests a line of sight only when its answer can have changed.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.frontiers import FrontierChanges, Frontiers
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS, cell_middle
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.mapping.squares import Layout
from common.mapping.thinning import LISTED, Blocks, block_at, blocks_of, list_block
from common.mapping.viewpoints import ViewpointGraph

IN_SIGHT: Final = CLEAR


class Pairs(NamedTuple):
    """Frontiers, one of each block, and the viewpoints in range of them; all int32.

    Attributes:
        cell: flat cell that each slot's pairs are drawn to, shape (capacity,).
        weight: frontier cells for which it stands, itself included.
        count: pairs of each slot.
        piece: their pieces, shape (capacity, most).
        state: IN_SIGHT or the blocking cell, same shape.
    """

    cell: NDArray[np.int32]
    weight: NDArray[np.int32]
    count: NDArray[np.int32]
    piece: NDArray[np.int32]
    state: NDArray[np.int32]


@njit(cache=True, nogil=True)
def _regroup(
    mask: NDArray[np.bool_],
    width: int,
    blocks: Blocks,
    cells: NDArray[np.int32],
    counts: NDArray[np.int32],
    slots: NDArray[np.int32],
    pairs: Pairs,
    used: int,
    listed: NDArray[np.int32],
    size: int,
) -> tuple[int, int]:
    """Bring the blocks of some cells up to date: give up slots whose cell stands for its block no more.

    Args:
        mask: frontier cells of the padded grid, flat, bool.
        width: its cells per row.
        blocks: of the grid.
        cells: flat cells that became frontiers or ceased to be, int32.
        counts: see `_update_pairs`.
        slots: likewise.
        pairs: likewise.
        used: slots in use.
        listed: receives the blocks that need a slot, int32.
        size: how many are listed already.

    Returns:
        Slots in use now, and how many blocks are listed.
    """
    members = np.empty(blocks.side * blocks.side, dtype=np.int32)
    for cell in cells:
        block = block_at(blocks, cell, width)
        slot = slots[block]
        if slot == LISTED:
            continue
        weight = list_block(mask, width, blocks, block, members)
        if slot >= 0:
            gained = weight - pairs.weight[slot]
            if weight and pairs.cell[slot] == members[0]:
                if gained:
                    pairs.weight[slot] = weight
                    for k in range(pairs.count[slot]):
                        if pairs.state[slot, k] == IN_SIGHT:
                            counts[pairs.piece[slot, k]] += gained
                continue
            for k in range(pairs.count[slot]):
                if pairs.state[slot, k] == IN_SIGHT:
                    counts[pairs.piece[slot, k]] -= pairs.weight[slot]
            used -= 1
            if slot != used:
                count = pairs.count[used]
                pairs.count[slot] = count
                pairs.piece[slot, :count] = pairs.piece[used, :count]
                pairs.state[slot, :count] = pairs.state[used, :count]
                pairs.cell[slot] = pairs.cell[used]
                pairs.weight[slot] = pairs.weight[used]
                slots[block_at(blocks, pairs.cell[slot], width)] = slot
            slots[block] = -1
        if weight:
            slots[block] = LISTED
            listed[size] = block
            size += 1
    return used, size


@njit(cache=True, nogil=True)
def _update_pairs(
    cells: NDArray[np.int8],
    mask: NDArray[np.bool_],
    width: int,
    blocks: Blocks,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    counts: NDArray[np.int32],
    reach: int,
    slots: NDArray[np.int32],
    pairs: Pairs,
    used: int,
    added: NDArray[np.int32],
    removed: NDArray[np.int32],
    fresh: NDArray[np.int32],
    ended: NDArray[np.int32],
    changed: Box,
    lost: Box,
) -> int:
    """Bring the counts of observable frontiers up to date.

    Blocks with frontiers live in slots 0 .. used - 1; the pairs of slot s are the first ``pairs.count[s]`` of its row.

    Args:
        cells: padded grid, flat, int8.
        mask: its frontier cells, flat, bool.
        width: its cells per row.
        blocks: of the grid.
        pieces: all pieces, see `common.mapping.pieces`.
        first_of: first piece of each square.
        layout: of the squares.
        counts: frontiers in range and in sight of each piece's viewpoint, int32; brought up to date.
        reach: observable range, subcells.
        slots: slot of each block or -1, int32.
        pairs: of the slots.
        used: slots in use.
        added: flat cells of new frontiers, int32.
        removed: flat cells that are frontiers no more, int32.
        fresh: pieces whose viewpoint is new, int32.
        ended: pieces whose viewpoint is no more, int32.
        changed: box of all cells that changed, and of all viewpoints that came or went.
        lost: box of the cells that are free no more; its second number is -1 when there are none.

    Returns:
        Slots in use now.
    """
    any_lost = lost[1] >= 0
    listed = np.empty(len(added) + len(removed), dtype=np.int32)
    used, size = _regroup(mask, width, blocks, removed, counts, slots, pairs, used, listed, 0)
    used, size = _regroup(mask, width, blocks, added, counts, slots, pairs, used, listed, size)

    counts[fresh] = 0
    is_ended = np.zeros(len(pieces), dtype=np.bool_)
    is_ended[ended] = True
    reach_cells = (reach >> SUBCELL_BITS) + 2
    for slot in range(used):
        row, column = pairs.cell[slot] // width, pairs.cell[slot] % width
        if (
            row < changed[0] - reach_cells
            or row > changed[1] + reach_cells
            or column < changed[2] - reach_cells
            or column > changed[3] + reach_cells
        ):
            continue
        x, y = cell_middle(pairs.cell[slot], width)
        weight = pairs.weight[slot]
        count = pairs.count[slot]
        k = 0
        while k < count:
            piece, state = pairs.piece[slot, k], pairs.state[slot, k]
            if is_ended[piece]:
                count -= 1
                pairs.piece[slot, k] = pairs.piece[slot, count]
                pairs.state[slot, k] = pairs.state[slot, count]
                continue
            if state == IN_SIGHT:
                test = any_lost and may_touch(x, y, pieces[piece].x, pieces[piece].y, lost)
            else:
                test = cells[state] == FREE
            if test:
                found = blocker(cells, width, x, y, pieces[piece].x, pieces[piece].y)
                counts[piece] += weight * ((found == CLEAR) - (state == IN_SIGHT))
                pairs.state[slot, k] = found
            k += 1
        for f in range(len(fresh)):
            to_x, to_y = pieces[fresh[f]].x, pieces[fresh[f]].y
            if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                found = blocker(cells, width, x, y, to_x, to_y)
                counts[fresh[f]] += weight * (found == CLEAR)
                pairs.piece[slot, count], pairs.state[slot, count] = fresh[f], found
                count += 1
        pairs.count[slot] = count

    columns = len(layout.x)
    members = np.empty(blocks.side * blocks.side, dtype=np.int32)
    for n in range(size):
        slot = used
        used += 1
        slots[listed[n]] = slot
        weight = list_block(mask, width, blocks, listed[n], members)
        pairs.cell[slot], pairs.weight[slot] = members[0], weight
        x, y = cell_middle(members[0], width)
        count = 0
        cell_low, cell_high = (
            max((y - reach) >> SUBCELL_BITS, 0),
            min((y + reach) >> SUBCELL_BITS, len(cells) // width - 1),
        )
        left, right = max((x - reach) >> SUBCELL_BITS, 0), min((x + reach) >> SUBCELL_BITS, width - 1)
        for j in range(layout.row_of[cell_low], layout.row_of[cell_high] + 1):
            for i in range(layout.column_of[left], layout.column_of[right] + 1):
                piece = first_of[j * columns + i]
                while piece >= 0:
                    if pieces[piece].exists:
                        to_x, to_y = pieces[piece].x, pieces[piece].y
                        if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                            found = blocker(cells, width, x, y, to_x, to_y)
                            counts[piece] += weight * (found == CLEAR)
                            pairs.piece[slot, count], pairs.state[slot, count] = piece, found
                            count += 1
                    piece = pieces[piece].next
        pairs.count[slot] = count
    return used


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
        for k in range(pairs.count[slot]):
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
        for k in range(pairs.count[slot]):
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
        self._used = 0
        self._pairs = _room(0, 64)

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
        self._used = _update_pairs(
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
            self._pairs = _room(capacity, width)
            _copy_pairs(pairs, self._pairs, self._used)


def _room(capacity: int, width: int) -> Pairs:
    """Return pairs for so many slots and viewpoints each; memory that nothing is written to is never really taken."""
    return Pairs(*np.empty((3, capacity), dtype=np.int32), *np.empty((2, capacity, width), dtype=np.int32))


@njit(cache=True, nogil=True)
def _copy_pairs(old: Pairs, new: Pairs, used: int) -> None:
    """Copy what is in use: rows are a fraction full, and a copy of whole ones would make a step wait."""
    for slot in range(used):
        count = old.count[slot]
        new.cell[slot], new.weight[slot], new.count[slot] = old.cell[slot], old.weight[slot], count
        new.piece[slot, :count] = old.piece[slot, :count]
        new.state[slot, :count] = old.state[slot, :count]

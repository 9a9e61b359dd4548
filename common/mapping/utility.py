"""Utility: how many frontiers each viewpoint observes, without testing any pair again to no purpose.

Every pair of a frontier and a viewpoint in range is in one of two states: in sight, or blocked by a cell that is
remembered. A blocked pair stays blocked as long as that cell is not free, and a pair in sight stays in sight as long
as no cell was lost, so an update tests a line of sight only when its answer can have changed.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.frontiers import FrontierChanges
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS, cell_middle
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.mapping.squares import Layout
from common.mapping.viewpoints import ViewpointGraph

IN_SIGHT: Final = CLEAR


@njit(cache=True, nogil=True)
def _update_pairs(
    cells: NDArray[np.int8],
    width: int,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    counts: NDArray[np.int32],
    reach: int,
    slots: NDArray[np.int32],
    slot_cell: NDArray[np.int32],
    pair_count: NDArray[np.int32],
    pair_piece: NDArray[np.int32],
    pair_state: NDArray[np.int32],
    used: int,
    added: NDArray[np.int32],
    removed: NDArray[np.int32],
    fresh: NDArray[np.int32],
    ended: NDArray[np.int32],
    changed: Box,
    lost: Box,
) -> int:
    """Bring the counts of observable frontiers up to date.

    Frontiers live in slots 0 .. used - 1; the pairs of slot s are the first ``pair_count[s]`` of its row.

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        pieces: all pieces, see `common.mapping.pieces`.
        first_of: first piece of each square.
        layout: of the squares.
        counts: frontiers in range and in sight of each piece's viewpoint, int32; brought up to date.
        reach: observable range, subcells.
        slots: slot of each cell or -1, int32, flat.
        slot_cell: flat cell of each slot, int32.
        pair_count: pairs of each slot, int32.
        pair_piece: their pieces, int32, shape (capacity, most).
        pair_state: IN_SIGHT or the blocking cell, int32, same shape.
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
    for i in range(len(removed)):
        slot = slots[removed[i]]
        slots[removed[i]] = -1
        for k in range(pair_count[slot]):
            if pair_state[slot, k] == IN_SIGHT:
                counts[pair_piece[slot, k]] -= 1
        used -= 1
        if slot != used:
            count = pair_count[used]
            pair_count[slot] = count
            pair_piece[slot, :count] = pair_piece[used, :count]
            pair_state[slot, :count] = pair_state[used, :count]
            slot_cell[slot] = slot_cell[used]
            slots[slot_cell[slot]] = slot

    counts[fresh] = 0
    is_ended = np.zeros(len(pieces), dtype=np.bool_)
    is_ended[ended] = True
    reach_cells = (reach >> SUBCELL_BITS) + 2
    for slot in range(used):
        row, column = slot_cell[slot] // width, slot_cell[slot] % width
        if (
            row < changed[0] - reach_cells
            or row > changed[1] + reach_cells
            or column < changed[2] - reach_cells
            or column > changed[3] + reach_cells
        ):
            continue
        x, y = cell_middle(slot_cell[slot], width)
        count = pair_count[slot]
        k = 0
        while k < count:
            piece, state = pair_piece[slot, k], pair_state[slot, k]
            if is_ended[piece]:
                count -= 1
                pair_piece[slot, k] = pair_piece[slot, count]
                pair_state[slot, k] = pair_state[slot, count]
                continue
            if state == IN_SIGHT:
                test = any_lost and may_touch(x, y, pieces[piece].x, pieces[piece].y, lost)
            else:
                test = cells[state] == FREE
            if test:
                found = blocker(cells, width, x, y, pieces[piece].x, pieces[piece].y)
                counts[piece] += (found == CLEAR) - (state == IN_SIGHT)
                pair_state[slot, k] = found
            k += 1
        for f in range(len(fresh)):
            to_x, to_y = pieces[fresh[f]].x, pieces[fresh[f]].y
            if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                found = blocker(cells, width, x, y, to_x, to_y)
                counts[fresh[f]] += found == CLEAR
                pair_piece[slot, count], pair_state[slot, count] = fresh[f], found
                count += 1
        pair_count[slot] = count

    columns = len(layout.x)
    for n in range(len(added)):
        slot = used
        used += 1
        slots[added[n]] = slot
        slot_cell[slot] = added[n]
        x, y = cell_middle(added[n], width)
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
                            counts[piece] += found == CLEAR
                            pair_piece[slot, count], pair_state[slot, count] = piece, found
                            count += 1
                    piece = pieces[piece].next
        pair_count[slot] = count
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
    slots: NDArray[np.int32],
    pair_count: NDArray[np.int32],
    pair_piece: NDArray[np.int32],
    pair_state: NDArray[np.int32],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """List the pairs in sight by node; see `FrontierUtility.sightings`."""
    pointer = np.zeros(nodes + 1, dtype=np.int64)
    for piece in range(len(numbers)):
        if numbers[piece] >= 0:
            pointer[numbers[piece] + 1] = counts[piece]
    for node in range(nodes):
        pointer[node + 1] += pointer[node]
    place = pointer[:nodes].copy()
    seen = np.empty(pointer[nodes], dtype=np.int32)
    for f in range(len(frontiers)):
        slot = slots[frontiers[f]]
        for k in range(pair_count[slot]):
            node = numbers[pair_piece[slot, k]]
            if node >= 0 and pair_state[slot, k] == IN_SIGHT:
                seen[place[node]] = f
                place[node] += 1
    return pointer, seen


@njit(cache=True, nogil=True)
def _overlooked(
    numbers: NDArray[np.int32],
    pieces: Any,
    slot_cell: NDArray[np.int32],
    pair_count: NDArray[np.int32],
    pair_piece: NDArray[np.int32],
    pair_state: NDArray[np.int32],
    used: int,
) -> NDArray[np.int32]:
    """Return the frontiers that no viewpoint shows; see `FrontierUtility.overlooked`."""
    shows = np.zeros(len(pieces), dtype=np.bool_)
    for piece in range(len(pieces)):
        shows[piece] = numbers[piece] >= 0 and not pieces[piece].visited
    found = np.empty(used, dtype=np.int32)
    size = 0
    for slot in range(used):
        shown = False
        for k in range(pair_count[slot]):
            if pair_state[slot, k] == IN_SIGHT and shows[pair_piece[slot, k]]:
                shown = True
                break
        if not shown:
            found[size] = slot_cell[slot]
            size += 1
    return found[:size]


class FrontierUtility:
    """How many frontiers each viewpoint observes, for one generation of the belief.

    Attributes:
        counts: frontiers in range and in line of sight of each piece's viewpoint, int32; void where it has none.
    """

    def __init__(self, belief: Belief, graph: ViewpointGraph, observable_range: float, spacing: float) -> None:
        self._graph = graph
        self._reach = round(observable_range / belief.resolution * SUBCELLS)
        # Squares that can hold viewpoints in range of one cell, in a row.
        self._side = int(2 * observable_range / spacing) + 3
        self.counts = np.zeros(graph.used, dtype=np.int32)
        self._slots = np.full(belief.padded.size, -1, dtype=np.int32)
        self._used = 0
        self._slot_cell = np.empty(0, dtype=np.int32)
        self._pair_count = np.empty(0, dtype=np.int32)
        self._pair_piece, self._pair_state = np.empty((2, 0, 64), dtype=np.int32)

    def update(self, cells: NDArray[np.int8], width: int, frontiers: FrontierChanges) -> None:
        """Bring the counts up to date; the graph must be so already.

        Args:
            cells: padded grid, flat, int8.
            width: its cells per row.
            frontiers: what became of the frontiers since the last update.
        """
        graph = self._graph
        if graph.changed[1] < 0:
            return
        self._reserve(self._used + len(frontiers.added) - len(frontiers.removed))
        self._used = _update_pairs(
            cells,
            width,
            graph.pieces,
            graph.first_of,
            graph.layout,
            self.counts,
            self._reach,
            self._slots,
            self._slot_cell,
            self._pair_count,
            self._pair_piece,
            self._pair_state,
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

        Args:
            frontiers: flat cells of the padded grid, all of them frontiers, int64, shape (m,).
            numbers: node number of each piece, -1 without one, int32.
            nodes: how many nodes there are.

        Returns:
            The first entry of each node, int64, shape (nodes + 1,), and the entries: places in `frontiers`,
            ascending for each node, int32.
        """
        pointer, seen = _sightings(
            frontiers, numbers, nodes, self.counts, self._slots, self._pair_count, self._pair_piece, self._pair_state
        )
        return pointer, seen

    def overlooked(self, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the frontiers that no node observes where the robot has not been, flat, int32, in no order.

        Args:
            numbers: node number of each piece, -1 without one, int32.
        """
        found: NDArray[np.int32] = _overlooked(
            numbers, self._graph.pieces, self._slot_cell, self._pair_count, self._pair_piece, self._pair_state,
            self._used,
        )  # fmt: skip
        return found

    @property
    def frontiers(self) -> NDArray[np.int32]:
        """All frontiers of the last update, flat cells of the padded grid, int32, in no order."""
        return self._slot_cell[: self._used]

    def _reserve(self, slots: int) -> None:
        graph = self._graph
        if graph.used > len(self.counts):
            self.counts = _lengthened(self.counts, graph.used)
        if slots > len(self._slot_cell):
            capacity = max(256, 2 * slots)
            self._slot_cell = _lengthened(self._slot_cell, capacity)
            self._pair_count = _lengthened(self._pair_count, capacity)
            self._pair_piece = _lengthened(self._pair_piece, capacity)
            self._pair_state = _lengthened(self._pair_state, capacity)
        width = self._pair_piece.shape[1]
        if graph.used > width and len(graph.fresh):
            most = int(_most_pairs(graph.pieces, graph.first_of, *graph.dirty.shape, self._side))
            if most > width:
                wider = np.empty((2, len(self._pair_piece), most + most // 2), dtype=np.int32)
                wider[0, :, :width], wider[1, :, :width] = self._pair_piece, self._pair_state
                self._pair_piece, self._pair_state = wider[0], wider[1]


def _lengthened(old: NDArray[np.int32], length: int) -> NDArray[np.int32]:
    new = np.zeros((length, *old.shape[1:]), dtype=np.int32)
    new[: len(old)] = old
    return new

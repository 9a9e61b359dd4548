"""Utility: how many frontiers each viewpoint observes, without ever testing the same pair twice in vain.

Every pair of a frontier and a viewpoint in range is in one of two states: in sight, or blocked by a cell that is
remembered. A blocked pair stays blocked as long as that cell is not free, and a pair in sight stays in sight as long
as no cell was lost, so an update tests a line of sight only when its answer can have changed.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.frontiers import FrontierChanges
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.mapping.viewpoints import ViewpointGraph

IN_SIGHT: Final = CLEAR
ABSENT: Final = -2  # in range, but no viewpoint there
OUT_OF_RANGE: Final = -3


@njit(cache=True, nogil=True)
def _update_pairs(
    cells: NDArray[np.int8],
    width: int,
    lattice_x: NDArray[np.int64],
    lattice_y: NDArray[np.int64],
    exists: NDArray[np.bool_],
    counts: NDArray[np.int32],
    reach: int,
    side: int,
    slots: NDArray[np.int32],
    slot_cell: NDArray[np.int32],
    slot_corner: NDArray[np.int32],
    states: NDArray[np.int32],
    used: int,
    added: NDArray[np.int32],
    removed: NDArray[np.int32],
    changed: Box,
    lost: Box,
) -> int:
    """Bring the counts of observable frontiers up to date.

    Frontiers live in slots 0 .. used - 1; slot s knows its pairs with the `side` x `side` lattice points from
    `slot_corner[s]` on.

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        lattice_x: x of the lattice's columns, subcells, int64, ascending.
        lattice_y: y of the lattice's rows, subcells, int64, ascending.
        exists: lattice points that are viewpoints, bool, shape (rows, columns).
        counts: frontiers in range and in sight per lattice point, int32, same shape; brought up to date.
        reach: observable range, subcells.
        side: lattice rows and columns that can be in range of one cell.
        slots: slot of each cell or -1, int32, flat.
        slot_cell: flat cell of each slot, int32.
        slot_corner: lattice row and column of each slot's first pair, int32, shape (capacity, 2).
        states: IN_SIGHT, ABSENT, OUT_OF_RANGE or the blocking cell, int32, shape (capacity, side * side).
        used: slots in use.
        added: flat cells of new frontiers, int32.
        removed: flat cells that are frontiers no more, int32.
        changed: box of all cells that changed.
        lost: box of the cells that are free no more; its second number is -1 when there are none.

    Returns:
        Slots in use now.
    """
    lattice_rows, lattice_columns = exists.shape
    any_lost = lost[1] >= 0
    for i in range(len(removed)):
        slot = slots[removed[i]]
        slots[removed[i]] = -1
        top, left = slot_corner[slot, 0], slot_corner[slot, 1]
        for k in range(side * side):
            if states[slot, k] == IN_SIGHT:
                counts[top + k // side, left + k % side] -= 1
        used -= 1
        if slot != used:
            states[slot] = states[used]
            slot_corner[slot] = slot_corner[used]
            slot_cell[slot] = slot_cell[used]
            slots[slot_cell[slot]] = slot

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
        x = column * SUBCELLS + SUBCELLS // 2
        y = row * SUBCELLS + SUBCELLS // 2
        top, left = slot_corner[slot, 0], slot_corner[slot, 1]
        k = -1
        for j in range(top, top + side):
            for i in range(left, left + side):
                k += 1
                state = states[slot, k]
                if state == OUT_OF_RANGE:
                    continue
                if state == ABSENT:
                    if not exists[j, i]:
                        continue
                elif any_lost and not exists[j, i]:
                    if state == IN_SIGHT:
                        counts[j, i] -= 1
                    states[slot, k] = ABSENT
                    continue
                elif state == IN_SIGHT:
                    if not (any_lost and may_touch(x, y, lattice_x[i], lattice_y[j], lost)):
                        continue
                elif cells[state] != FREE:
                    continue
                found = blocker(cells, width, x, y, lattice_x[i], lattice_y[j])
                counts[j, i] += (found == CLEAR) - (state == IN_SIGHT)
                states[slot, k] = found

    for n in range(len(added)):
        slot = used
        used += 1
        slots[added[n]] = slot
        slot_cell[slot] = added[n]
        x = (added[n] % width) * SUBCELLS + SUBCELLS // 2
        y = (added[n] // width) * SUBCELLS + SUBCELLS // 2
        top = np.searchsorted(lattice_y, y - reach)
        left = np.searchsorted(lattice_x, x - reach)
        slot_corner[slot, 0] = top
        slot_corner[slot, 1] = left
        k = -1
        for j in range(top, top + side):
            for i in range(left, left + side):
                k += 1
                states[slot, k] = OUT_OF_RANGE
                if j >= lattice_rows or i >= lattice_columns:
                    continue
                dx, dy = lattice_x[i] - x, lattice_y[j] - y
                if dx * dx + dy * dy > reach * reach:
                    continue
                states[slot, k] = ABSENT
                if exists[j, i]:
                    found = blocker(cells, width, x, y, lattice_x[i], lattice_y[j])
                    counts[j, i] += found == CLEAR
                    states[slot, k] = found
    return used


@njit(cache=True, nogil=True)
def _sightings(
    slots: NDArray[np.int32],
    slot_corner: NDArray[np.int32],
    states: NDArray[np.int32],
    side: int,
    counts: NDArray[np.int32],
    frontiers: NDArray[np.int64],
    numbers: NDArray[np.int32],
    nodes: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """List the pairs in sight by node; see `FrontierUtility.sightings`."""
    columns = counts.shape[1]
    pointer = np.zeros(nodes + 1, dtype=np.int64)
    for point in range(len(numbers)):
        if numbers[point] >= 0:
            pointer[numbers[point] + 1] = counts[point // columns, point % columns]
    for node in range(nodes):
        pointer[node + 1] += pointer[node]
    place = pointer[:nodes].copy()
    seen = np.empty(pointer[nodes], dtype=np.int32)
    for f in range(len(frontiers)):
        slot = slots[frontiers[f]]
        pairs = states[slot]
        left = slot_corner[slot, 1]
        k = 0
        for j in range(slot_corner[slot, 0], slot_corner[slot, 0] + side):
            for i in range(left, left + side):
                if pairs[k] == IN_SIGHT:
                    node = numbers[j * columns + i]
                    if node >= 0:
                        seen[place[node]] = f
                        place[node] += 1
                k += 1
    return pointer, seen


class FrontierUtility:
    """How many frontiers each lattice point observes, for one generation of the belief.

    Attributes:
        counts: frontiers in range and in line of sight, int32, shape of the lattice; 0 where no viewpoint is.
    """

    def __init__(self, belief: Belief, graph: ViewpointGraph, observable_range: float, spacing: float) -> None:
        self._graph = graph
        self.counts = np.zeros(graph.exists.shape, dtype=np.int32)
        self._reach = round(observable_range / belief.resolution * SUBCELLS)
        self._side = int(2 * observable_range / spacing + 1e-3) + 1
        self._slots = np.full(belief.padded.size, -1, dtype=np.int32)
        self._used = 0
        self._slot_cell = np.empty(0, dtype=np.int32)
        self._slot_corner = np.empty((0, 2), dtype=np.int32)
        self._states = np.empty((0, self._side**2), dtype=np.int32)

    def update(self, cells: NDArray[np.int8], width: int, changed: Box, frontiers: FrontierChanges) -> None:
        """Bring the counts up to date; the graph must be so already.

        Args:
            cells: padded grid, flat, int8.
            width: its cells per row.
            changed: box of all cells that changed since the last update.
            frontiers: what became of the frontiers since then.
        """
        self._reserve(self._used + len(frontiers.added) - len(frontiers.removed))
        self._used = _update_pairs(
            cells,
            width,
            self._graph.x,
            self._graph.y,
            self._graph.exists,
            self.counts,
            self._reach,
            self._side,
            self._slots,
            self._slot_cell,
            self._slot_corner,
            self._states,
            self._used,
            frontiers.added,
            frontiers.removed,
            changed,
            frontiers.lost,
        )

    def sightings(
        self, frontiers: NDArray[np.int64], numbers: NDArray[np.int32], nodes: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return which frontiers each node observes, from what the last update knows; nothing is looked at again.

        Args:
            frontiers: flat cells of the padded grid, all of them frontiers, int64, shape (m,).
            numbers: node number of each lattice point or -1, int32, flat.
            nodes: how many nodes there are.

        Returns:
            The first entry of each node, int64, shape (nodes + 1,), and the entries: places in `frontiers`,
            ascending for each node, int32.
        """
        return _sightings(
            self._slots, self._slot_corner, self._states, self._side, self.counts, frontiers, numbers, nodes
        )

    def _reserve(self, slots: int) -> None:
        if slots > len(self._slot_cell):
            capacity = max(256, 2 * slots)
            self._slot_cell = _lengthened(self._slot_cell, capacity)
            self._slot_corner = _lengthened(self._slot_corner, capacity)
            self._states = _lengthened(self._states, capacity)


def _lengthened(old: NDArray[np.int32], length: int) -> NDArray[np.int32]:
    new = np.empty((length, *old.shape[1:]), dtype=np.int32)
    new[: len(old)] = old
    return new

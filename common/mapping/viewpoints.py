"""The viewpoint graph: lattice points in free cells, edges in line of sight, and what the robot can reach of it."""

from __future__ import annotations

from math import ceil, floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS

# Edges are symmetric (the reverse of bit k is bit 19 - k), so blocking cells are kept for the second half of the bits.
HALF: Final = NEIGHBOUR_COUNT // 2
UNTESTED: Final = -1
# The robot's node is looked for within this many spacings.
NODE_REACH: Final = 3.0


@njit(cache=True, nogil=True)
def _update_edges(
    cells: NDArray[np.int8],
    width: int,
    lattice_x: NDArray[np.int64],
    lattice_y: NDArray[np.int64],
    offsets: NDArray[np.int16],
    exists: NDArray[np.bool_],
    edges: NDArray[np.uint32],
    blockers: NDArray[np.int32],
    changed: Box,
    lost: Box,
) -> None:
    """Bring viewpoints and edges up to date around a box of changed cells.

    An edge that is blocked stays so while its remembered blocking cell is not free; one that is there stays while no
    cell near it was lost. Only the others are tested.

    Args:
        cells: padded grid, flat, int8.
        width: its cells per row.
        lattice_x: x of the lattice's columns, subcells, int64, ascending.
        lattice_y: y of the lattice's rows, likewise.
        offsets: the 20 neighbour offsets (dx, dy).
        exists: lattice points that are viewpoints, bool, shape (rows, columns); brought up to date.
        edges: 20-bit masks, uint32, same shape; brought up to date.
        blockers: blocking cell of the half edges or UNTESTED, int32, shape (rows, columns, 10).
        changed: box of all cells that changed.
        lost: box of the cells that are free no more; its second number is -1 when there are none.
    """
    rows, columns = exists.shape
    any_lost = lost[1] >= 0
    # Lattice points whose cell lies in the box.
    j_low = int(np.searchsorted(lattice_y, changed[0] * SUBCELLS))
    j_high = int(np.searchsorted(lattice_y, (changed[1] + 1) * SUBCELLS))
    i_low = int(np.searchsorted(lattice_x, changed[2] * SUBCELLS))
    i_high = int(np.searchsorted(lattice_x, (changed[3] + 1) * SUBCELLS))
    for j in range(j_low, j_high):
        for i in range(i_low, i_high):
            exists[j, i] = cells[(lattice_y[j] >> SUBCELL_BITS) * width + (lattice_x[i] >> SUBCELL_BITS)] == FREE
    # Every edge that can touch a cell of the box; a point on the upper border of the box still touches it.
    for j in range(max(j_low - 2, 0), min(j_high + 1, rows)):
        for i in range(max(i_low - 2, 0), min(i_high + 3, columns)):
            for k in range(HALF):
                bit = np.uint32(1) << np.uint32(HALF + k)
                is_edge = (edges[j, i] & bit) != 0
                to_i = i + offsets[HALF + k, 0]
                to_j = j + offsets[HALF + k, 1]
                if not (0 <= to_i < columns and to_j < rows):
                    continue
                found = UNTESTED
                if exists[j, i] and exists[to_j, to_i]:
                    x0, y0, x1, y1 = lattice_x[i], lattice_y[j], lattice_x[to_i], lattice_y[to_j]
                    if is_edge:
                        if not (any_lost and may_touch(x0, y0, x1, y1, lost)):
                            continue
                    elif blockers[j, i, k] != UNTESTED and cells[blockers[j, i, k]] != FREE:
                        continue
                    found = blocker(cells, width, x0, y0, x1, y1)
                    if found == CLEAR:
                        edges[j, i] |= bit
                        edges[to_j, to_i] |= np.uint32(1) << np.uint32(HALF - 1 - k)
                        continue
                elif not is_edge:
                    continue
                blockers[j, i, k] = found
                if is_edge:
                    edges[j, i] &= ~bit
                    edges[to_j, to_i] &= ~(np.uint32(1) << np.uint32(HALF - 1 - k))


@njit(cache=True, nogil=True)
def _robot_node(
    cells: NDArray[np.int8],
    width: int,
    lattice_x: NDArray[np.int64],
    lattice_y: NDArray[np.int64],
    exists: NDArray[np.bool_],
    edges: NDArray[np.uint32],
    x: int,
    y: int,
    reach: int,
) -> int:
    """Return the flat lattice index of the robot's node, or -1; see `ViewpointGraph.robot_node`."""
    rows, columns = exists.shape
    best = -1
    best_distance = np.int64(0)
    best_has_edges = False
    for j in range(np.searchsorted(lattice_y, y - reach), rows):
        if lattice_y[j] > y + reach:
            break
        for i in range(np.searchsorted(lattice_x, x - reach), columns):
            if lattice_x[i] > x + reach:
                break
            if not exists[j, i]:
                continue
            dx, dy = lattice_x[i] - x, lattice_y[j] - y
            distance = dx * dx + dy * dy
            has_edges = edges[j, i] != 0
            if distance > reach * reach or (
                best >= 0
                and (has_edges < best_has_edges or (has_edges == best_has_edges and distance >= best_distance))
            ):
                continue
            same_cell = (
                lattice_x[i] >> SUBCELL_BITS == x >> SUBCELL_BITS and lattice_y[j] >> SUBCELL_BITS == y >> SUBCELL_BITS
            )
            if same_cell or blocker(cells, width, x, y, lattice_x[i], lattice_y[j]) == CLEAR:
                best = j * columns + i
                best_distance = distance
                best_has_edges = has_edges
    return best


@njit(cache=True, nogil=True)
def _number_reachable(
    edges: NDArray[np.uint32], offsets: NDArray[np.int16], start: int, numbers: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Number the viewpoints that edges connect with `start`, row-major, and return their flat lattice indices.

    Args:
        edges: 20-bit masks, uint32, shape (rows, columns).
        offsets: the 20 neighbour offsets (dx, dy).
        start: flat lattice index.
        numbers: receives the node number of every lattice point, -1 where it has none, int32, shape (rows * columns,).
    """
    rows, columns = edges.shape
    numbers[:] = -1
    stack = np.empty(rows * columns, dtype=np.int32)
    stack[0] = start
    numbers[start] = 0
    size = 1
    total = 1
    row_low = row_high = start // columns
    while size:
        size -= 1
        here = stack[size]
        mask = edges[here // columns, here % columns]
        for k in range(NEIGHBOUR_COUNT):
            if (mask >> np.uint32(k)) & np.uint32(1):
                there = here + offsets[k, 1] * columns + offsets[k, 0]
                if numbers[there] < 0:
                    numbers[there] = 0
                    stack[size] = there
                    size += 1
                    total += 1
                    row = there // columns
                    row_low, row_high = min(row_low, row), max(row_high, row)
    order = np.empty(total, dtype=np.int32)
    n = 0
    for index in range(row_low * columns, (row_high + 1) * columns):
        if numbers[index] == 0:
            numbers[index] = n
            order[n] = index
            n += 1
    return order


class ViewpointGraph:
    """All viewpoints of one generation of the belief and their edges, kept up to date where the belief changed.

    Lattice points are ``lattice_origin + spacing * (i, j)``; the arrays hold those in the belief's grid, one row for
    each j, one column for each i.

    Attributes:
        x: of each lattice column, subcells of the padded grid, int64, ascending.
        y: of each lattice row, likewise.
        first: numbers (i, j) of the lattice point at row 0, column 0; unlike array indices they outlive a growth.
        exists: lattice points that are viewpoints, bool, shape (rows, columns).
        edges: 20-bit masks over `NEIGHBOUR_OFFSETS`, uint32, same shape; symmetric.
        visited: lattice points where the robot has been, bool, same shape.
    """

    def __init__(
        self,
        belief: Belief,
        lattice_origin: tuple[float, float],
        spacing: float,
        previous: ViewpointGraph | None = None,
    ) -> None:
        """Lay the lattice over the belief's grid; viewpoints and edges appear with the first update.

        Args:
            belief: its grid as it is allocated now.
            lattice_origin: (x, y) of one lattice point, metres.
            spacing: between neighbouring points, metres.
            previous: graph of an earlier generation of the belief, from which the visited flags are taken over.
        """
        rows, columns = belief.shape
        self.x, i = _axis(belief, lattice_origin, spacing, 0, columns)
        self.y, j = _axis(belief, lattice_origin, spacing, 1, rows)
        self.first = (i, j)
        shape = (len(self.y), len(self.x))
        self.exists = np.zeros(shape, dtype=np.bool_)
        self.edges = np.zeros(shape, dtype=np.uint32)
        self.visited = np.zeros(shape, dtype=np.bool_)
        if previous is not None:
            down, right = previous.first[1] - j, previous.first[0] - i
            rows, columns = previous.visited.shape
            self.visited[down : down + rows, right : right + columns] = previous.visited
        self._blockers = np.full((*shape, HALF), UNTESTED, dtype=np.int32)
        self._numbers = np.empty(shape[0] * shape[1], dtype=np.int32)
        self._reach = round(NODE_REACH * spacing / belief.resolution * SUBCELLS)

    def update(self, cells: NDArray[np.int8], width: int, changed: Box, lost: Box) -> None:
        """Bring viewpoints and edges up to date; arguments as `_update_edges` describes them."""
        _update_edges(
            cells, width, self.x, self.y, NEIGHBOUR_OFFSETS, self.exists, self.edges, self._blockers, changed, lost
        )

    def robot_node(self, cells: NDArray[np.int8], width: int, x: int, y: int) -> int:
        """Return the flat lattice index of the robot's node, or -1 when there is none within 3 spacings.

        It is the nearest viewpoint in a straight free line; one that has edges is preferred, however, because a
        robot that counts as being on a viewpoint without edges could go nowhere.
        """
        return int(_robot_node(cells, width, self.x, self.y, self.exists, self.edges, x, y, self._reach))

    def number_reachable(self, start: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Number the viewpoints that edges connect with a viewpoint.

        Returns:
            Flat lattice index of every node, int32, shape (n,), row-major; and the node number of every lattice
            point or -1, int32, flat, valid until the next call.
        """
        return _number_reachable(self.edges, NEIGHBOUR_OFFSETS, start, self._numbers), self._numbers


def _axis(
    belief: Belief, lattice_origin: tuple[float, float], spacing: float, axis: int, cells: int
) -> tuple[NDArray[np.int64], int]:
    """Return the subcells of the lattice's points along one axis of the grid and the number of the first of them."""
    low = (belief.origin[axis] - lattice_origin[axis]) / spacing
    numbers = range(floor(low), ceil(low + cells * belief.resolution / spacing) + 1)
    values = [lattice_origin[axis] + spacing * k for k in numbers]
    subcells = np.array([belief.subcells((v, v))[axis] for v in values], dtype=np.int64)
    inside = (subcells >> SUBCELL_BITS >= 1) & (subcells >> SUBCELL_BITS <= cells)
    return subcells[inside], numbers[int(np.argmax(inside))]

"""The world at its best: what the belief does not forbid, unknown space taken as free."""

from __future__ import annotations

from math import ceil, floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.belief import Belief
from common.mapping.raycast import SUBCELL_BITS, to_subcells
from common.mapping.sight import CLEAR, FREE, OCCUPIED, Box, blocker, may_touch
from common.mapping.viewpoints import LONGEST_EDGE
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS
from common.planners.base import Position
from common.planners.grid_search import NO_WAY, UNITS
from common.planners.lattice import TOLERANCE

# The lattice goes on this many spacings beyond the belief, the robot and the target: ways around what is known, through
# what is not, are part of the world at its best.
MARGIN: Final = 3
_HALF: Final = NEIGHBOUR_COUNT // 2


@njit(cache=True, nogil=True)
def _update_edges(
    possible: NDArray[np.int8],
    known: NDArray[np.int8],
    width: int,
    lattice_x: NDArray[np.int64],
    lattice_y: NDArray[np.int64],
    offsets: NDArray[np.int16],
    scanned: NDArray[np.bool_],
    closed: NDArray[np.bool_],
    edges: NDArray[np.uint32],
    box: Box,
) -> None:
    """Test every edge that can touch a box of cells; arguments as `OptimisticLattice` keeps them."""
    rows, columns = edges.shape
    for j in range(rows):
        for i in range(columns):
            for k in range(_HALF, NEIGHBOUR_COUNT):
                to_i, to_j = i + offsets[k, 0], j + offsets[k, 1]
                if not (0 <= to_i < columns and to_j < rows):
                    continue
                x0, y0, x1, y1 = lattice_x[i], lattice_y[j], lattice_x[to_i], lattice_y[to_j]
                if not may_touch(x0, y0, x1, y1, box):
                    continue
                open_ = not (closed[j, i] or closed[to_j, to_i])
                if open_:
                    seen = scanned[j, i] or scanned[to_j, to_i]
                    open_ = blocker(known if seen else possible, width, x0, y0, x1, y1) == CLEAR
                bit = np.uint32(1) << np.uint32(k)
                back = np.uint32(1) << np.uint32(NEIGHBOUR_COUNT - 1 - k)
                if open_:
                    edges[j, i] |= bit
                    edges[to_j, to_i] |= back
                else:
                    edges[j, i] &= ~bit
                    edges[to_j, to_i] &= ~back


def join(a: Box | None, b: Box) -> Box:
    """Return the box around two boxes."""
    if a is None:
        return b
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])


class OptimisticGrid:
    """Two copies of the belief's cells on a rectangle that reaches beyond it: as they are, and unknown as free.

    Kernels take the copies as padded grids: nothing that is looked at comes near their border.

    Attributes:
        known: int8, shape (rows, columns): unknown, free, occupied.
        possible: same shape: occupied where the belief says so, free everywhere else.
        origin: (x, y) of the lower left corner, metres.
        resized: whether the last update moved the rectangle, so that cells and subcells of before are void.
    """

    def __init__(self, margin: float) -> None:
        """Cover nothing yet; `margin`, metres, is how far the rectangle reaches beyond what it must hold."""
        self._margin = margin
        self._low = self._high = (np.inf, np.inf)
        self.origin = (0.0, 0.0)
        self.resolution = 1.0
        self.known = self.possible = np.empty((0, 0), dtype=np.int8)
        self.resized = False
        self._doubtful: list[tuple[Position, bool]] = []
        self._pending: Box | None = None

    def update(self, belief: Belief, *places: Position) -> Box | None:
        """Copy what the belief says now, on a rectangle that holds all of its grid and the places, metres.

        Returns:
            Box that holds all changes (first row, last row, first column, last column), all of it after a resize;
            None when nothing changed.
        """
        self.resized = self._fit(belief, places)
        known = belief.window(self.origin, self.known.shape)
        box, self._pending = self._pending, None
        if self.resized:
            box = (0, known.shape[0] - 1, 0, known.shape[1] - 1)
        else:
            different = known != self.known
            rows = np.flatnonzero(different.any(axis=1))
            if len(rows):
                columns = np.flatnonzero(different[rows[0] : rows[-1] + 1].any(axis=0))
                box = join(box, (int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])))
        if box is None:
            return None
        self.known = known
        self.possible = np.where(known == OCCUPIED, np.int8(OCCUPIED), np.int8(FREE))
        for position, always in self._doubtful:
            row, column = self.cell(position)
            if always or known[row, column] != FREE:
                self.possible[row, column] = OCCUPIED
        return box

    def doubt(self, position: Position, *, always: bool = False) -> None:
        """Take the cell at a position for an obstacle from the next update on, until it is known to be free.

        For cells that a scan from nearby left unknown: the robot may not drive there, so hoping is no use. With
        `always`, for cells that the robot cannot get to, whatever the belief says.
        """
        row, column = self.cell(position)
        self._doubtful.append((position, always))
        self._pending = join(self._pending, (row, row, column, column))

    def cell(self, position: Position) -> tuple[int, int]:
        """Return the (row, column) that holds a position."""
        x, y = self.subcells(position)
        return y >> SUBCELL_BITS, x >> SUBCELL_BITS

    def subcells(self, position: Position) -> tuple[int, int]:
        """Return a position in subcells from the lower left corner of the copies."""
        return (
            int(to_subcells(position[0], self.origin[0], self.resolution)),
            int(to_subcells(position[1], self.origin[1], self.resolution)),
        )

    def free(self, a: Position, b: Position) -> bool:
        """Whether the straight segment between two places inside the rectangle is known to be free."""
        return self._clear(self.known, a, b)

    def possibly_free(self, a: Position, b: Position) -> bool:
        """Whether the straight segment between two places inside the rectangle touches no occupied cell."""
        return self._clear(self.possible, a, b)

    def _clear(self, cells: NDArray[np.int8], a: Position, b: Position) -> bool:
        points = (*self.subcells(a), *self.subcells(b))
        return bool(blocker(cells.reshape(-1), cells.shape[1], *points) == CLEAR)

    def _fit(self, belief: Belief, places: tuple[Position, ...]) -> bool:
        """Move the rectangle when it does not hold all that it must; return whether it did."""
        rows, columns = belief.shape
        self.resolution = step = belief.resolution
        corners = [belief.origin, (belief.origin[0] + columns * step, belief.origin[1] + rows * step), *places]
        low = (min(x for x, _ in corners), min(y for _, y in corners))
        high = (max(x for x, _ in corners), max(y for _, y in corners))
        if self.known.size:
            low = (min(low[0], self._low[0]), min(low[1], self._low[1]))
            high = (max(high[0], self._high[0]), max(high[1], self._high[1]))
            if low == self._low and high == self._high:
                return False
        self._low, self._high = low, high
        # On corners of cells.
        before = [ceil((belief.origin[axis] - low[axis] + self._margin) / step) for axis in (0, 1)]
        after = [ceil((high[axis] - belief.origin[axis] + self._margin) / step) for axis in (0, 1)]
        self.origin = (belief.origin[0] - before[0] * step, belief.origin[1] - before[1] * step)
        self.known = np.empty((before[1] + after[1], before[0] + after[0]), dtype=np.int8)
        return True


class OptimisticLattice:
    """The viewpoint lattice with every edge that the belief does not forbid, and the last legs to a target.

    An edge is there unless it touches an occupied cell. Edges from viewpoints that the robot has scanned from are
    there only when they are known to be free: another scan from the same place would tell nothing new about them.

    Attributes:
        grid: the cells underneath.
        edges: 20-bit masks over `NEIGHBOUR_OFFSETS`, uint32, shape (rows, columns), symmetric.
        goal_units: length of the last leg from each lattice point to the target, `NO_WAY` where there is none, int64,
            shape (rows * columns,), see `common.planners.grid_search`.
        heuristic: straight distance from each lattice point to the target, rounded down, likewise.
        grown: rows and columns that the last update put before the old ones, or None when it did not grow.
    """

    def __init__(self, spacing: float, target: Position) -> None:
        """Cover nothing yet.

        Args:
            spacing: of the viewpoints, metres.
            target: metres.
        """
        self.grid = OptimisticGrid(MARGIN * spacing)
        self.edges = np.empty((0, 0), dtype=np.uint32)
        self.goal_units = self.heuristic = np.empty(0, dtype=np.int64)
        self.grown: tuple[int, int] | None = None
        self._spacing = spacing
        self._target = target
        self._phase: Position | None = None
        self._first = (0, 0)
        self._scanned = self._closed = np.empty((0, 0), dtype=np.bool_)
        self._marks: list[tuple[int, int]] = []

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of lattice points."""
        return self.edges.shape[0], self.edges.shape[1]

    def update(self, belief: Belief, viewpoint: Position, *, scanned: bool) -> int:
        """Bring all up to date with the belief.

        Args:
            belief: what the robot knows.
            viewpoint: position of the robot's node, metres; the lattice goes through it.
            scanned: the robot has scanned from this viewpoint.

        Returns:
            The robot's lattice point, flat index.
        """
        if self._phase is None:
            self._phase = viewpoint
        box = self.grid.update(belief, viewpoint, self._target)
        if self.grid.resized:
            self._lay(belief)
        else:
            self.grown = None
        j, i = self._numbers(viewpoint)
        if scanned and not self._scanned[j, i]:
            self._scanned[j, i] = True
            box = join(box, self._around(j, i))
        for j_marked, i_marked in self._marks:
            box = join(box, self._around(j_marked, i_marked))
        self._marks = []
        if box is not None:
            self._refresh(box)
        return j * self.edges.shape[1] + i

    def close(self, position: Position) -> None:
        """Give up a viewpoint that the robot does not get to, from the next update on."""
        j, i = self._numbers(position)
        self._closed[j, i] = True
        self._marks.append((j, i))

    def position(self, node: int) -> Position:
        """Return the position of a lattice point, metres."""
        assert self._phase is not None
        j, i = divmod(node, self.edges.shape[1])
        return (
            self._phase[0] + (i + self._first[1]) * self._spacing,
            self._phase[1] + (j + self._first[0]) * self._spacing,
        )

    def _numbers(self, position: Position) -> tuple[int, int]:
        assert self._phase is not None
        return (
            round((position[1] - self._phase[1]) / self._spacing) - self._first[0],
            round((position[0] - self._phase[0]) / self._spacing) - self._first[1],
        )

    def _lay(self, belief: Belief) -> None:
        """Lay the lattice over the grid, at least one cell away from its border."""
        assert self._phase is not None
        step, spacing = belief.resolution, self._spacing
        counts = (self.grid.known.shape[1], self.grid.known.shape[0])
        low = [ceil((self.grid.origin[k] + step - self._phase[k]) / spacing - TOLERANCE) for k in (0, 1)]
        high = [
            floor((self.grid.origin[k] + (counts[k] - 1) * step - self._phase[k]) / spacing - TOLERANCE) for k in (0, 1)
        ]
        first = (low[1], low[0])
        shape = (high[1] - low[1] + 1, high[0] - low[0] + 1)
        rows, columns = self.shape
        down, left = self._first[0] - first[0], self._first[1] - first[1]
        part = np.s_[down : down + rows, left : left + columns]
        flags = []
        for old in (self._scanned, self._closed):
            new = np.zeros(shape, dtype=np.bool_)
            if old.size:
                new[part] = old
            flags.append(new)
        self._scanned, self._closed = flags
        self.grown = (down, left) if rows else (0, 0)
        self._first = first
        self.edges = np.zeros(shape, dtype=np.uint32)
        xs = self._phase[0] + (first[1] + np.arange(shape[1])) * spacing
        ys = self._phase[1] + (first[0] + np.arange(shape[0])) * spacing
        self._x = np.array([self.grid.subcells((x, 0.0))[0] for x in xs], dtype=np.int64)
        self._y = np.array([self.grid.subcells((0.0, y))[1] for y in ys], dtype=np.int64)
        straight = np.hypot(xs[None, :] - self._target[0], ys[:, None] - self._target[1]).reshape(-1) / spacing
        # One unit less than the floor: no rounding makes it more than a way that was rounded up.
        self.heuristic = np.maximum(np.floor(straight * UNITS).astype(np.int64) - 1, 0)
        self._near = np.flatnonzero(straight <= LONGEST_EDGE + TOLERANCE)
        self._legs = np.ceil(straight[self._near] * UNITS).astype(np.int64)
        self.goal_units = np.full(len(straight), NO_WAY, dtype=np.int64)

    def _refresh(self, box: Box) -> None:
        """Test the edges and the last legs that can touch a box of cells."""
        grid = self.grid
        width = grid.known.shape[1]
        known, possible = grid.known.reshape(-1), grid.possible.reshape(-1)
        _update_edges(
            possible,
            known,
            width,
            self._x,
            self._y,
            NEIGHBOUR_OFFSETS,
            self._scanned,
            self._closed,
            self.edges,
            box,
        )
        x, y = grid.subcells(self._target)
        scanned, closed = self._scanned.reshape(-1), self._closed.reshape(-1)
        for node, leg in zip(self._near.tolist(), self._legs.tolist(), strict=True):
            j, i = divmod(node, self.edges.shape[1])
            cells = known if scanned[node] else possible
            open_ = not closed[node] and blocker(cells, width, self._x[i], self._y[j], x, y) == CLEAR
            self.goal_units[node] = leg if open_ else NO_WAY

    def _around(self, j: int, i: int) -> Box:
        """Return the box of cells that edges of a lattice point can touch."""
        reach = 2 * ceil(self._spacing / self.grid.resolution)
        row, column = int(self._y[j]) >> SUBCELL_BITS, int(self._x[i]) >> SUBCELL_BITS
        return row - reach, row + reach, column - reach, column + reach

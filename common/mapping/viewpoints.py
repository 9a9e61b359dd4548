"""The viewpoint graph: a viewpoint for each piece of clear space inside a lattice square, and the ways between them.

Wherever a disc of the robot's radius can get to through known free space, the graph leads: pieces that touch are
joined, and a piece is connected in itself. On block maps and for a robot without size this is the plain lattice.
"""

from __future__ import annotations

from math import ceil
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.adjacency import Adjacency, reach
from common.mapping.cell_grid import AnchoredGrid
from common.mapping.clearance import Clearance
from common.mapping.lookouts import Remains, nearest_first
from common.mapping.pieces import NOWHERE, PIECE, Cells
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS, cell_middle
from common.mapping.renewal import Pairs, Touches, renew_edges, renew_viewpoints
from common.mapping.settling import label_dirty
from common.mapping.sight import NOTHING_LOST, Box
from common.mapping.squares import lay_out
from common.mapping.standing import MARGIN_REACH, piece_of, pieces_at, way_out
from common.mapping.ways import way_between, way_inside

# The longest straight edge, spacings: on a lattice, the 20 nearest viewpoints lie within it.
LONGEST_EDGE: Final = 5.0**0.5
# Space around a viewpoint beside its lattice point that counts, metres.
PLACE_MARGIN: Final = 0.5
# So near to a place where the robot has been, another look shows nothing new, metres.
BEEN_REACH: Final = 0.3
_NO_PIECES: Final = np.zeros(0, dtype=np.int32)
Reached = tuple[NDArray[np.int32], NDArray[np.int32], Adjacency]
"""What `ViewpointGraph.reachable` returns."""
_NOTHING_REMAINS: Final = Remains(_NO_PIECES, _NO_PIECES, 0, 1)


class ViewpointGraph:
    """All viewpoints of one generation of the belief and their edges, kept up to date where the belief changed.

    The lattice parts the plane into squares with a lattice point in the middle of each. Every connected piece of clear
    space inside a square has one viewpoint: at the lattice point where that is clear, else at the piece's best place.
    Pieces that touch are joined by a way inside both; viewpoints within sqrt(5) spacings and two squares of each other
    by a straight edge, where the line between them is clear.

    At the rim of known space squares are seen in part, and a piece of such a square is seldom what it will be. So a
    piece waits for its lattice point while its square is partly unknown and no wall was seen in it, as long as the
    robot has not been next door: from there it would have seen the lattice point, if there were a way to it. Once
    nothing else is left to look at, no piece waits, and viewpoints move to where frontiers beside their pieces can be
    seen from near (`common.mapping.lookouts`); `Mapper` lets those of a robot with a radius move early, where the robot
    has been in their pieces.

    Attributes:
        layout: the squares.
        first: numbers (i, j) of the lattice point of square (0, 0); unlike array indices they outlive a growth.
        pieces: all pieces, of dtype `PIECE`.
        robot: the piece in which the robot stands, -1 when it stands in none and sees none near; its viewpoint exists.
        dirty: squares that an update has to look at, bool, shape (rows, columns); set by whoever knows of changes.
        beside: squares within ``layout.margin`` cells of changes, likewise.
        fresh: pieces whose viewpoint is new since the update before, int32.
        ended: pieces whose viewpoint is no more, likewise.
        changed: box of cells around all of them and around all changes; its second number is -1 without any.
    """

    def __init__(
        self,
        belief: AnchoredGrid,
        lattice_origin: tuple[float, float],
        spacing: float,
        radius: float = 0.0,
        previous: ViewpointGraph | None = None,
    ) -> None:
        """Lay the squares over the belief's grid; viewpoints and edges appear with the first update.

        Args:
            belief: its grid as it is allocated now.
            lattice_origin: (x, y) of one lattice point, metres.
            spacing: between neighbouring lattice points, metres.
            radius: of the robot, metres, 0 allowed.
            previous: graph of an earlier generation of the belief, which knows where the robot has been.
        """
        # Where a viewpoint has its place depends on cells so far beside its square.
        side = int(spacing / belief.resolution)
        self._margin = min(max(round(PLACE_MARGIN / belief.resolution), 1), side)
        self.layout, self.first = lay_out(belief, lattice_origin, spacing, self._margin)
        self._clearance = Clearance(belief, radius)
        shape = belief.padded.shape
        been: NDArray[np.bool_] = np.zeros(shape, dtype=np.bool_)
        self._first_cell = belief.first_cell
        if previous is not None:
            down, right = (a - b for a, b in zip(previous._first_cell, self._first_cell, strict=True))
            # Without their rings: an empty grid lies nowhere.
            known: NDArray[np.bool_] = previous._been[1:-1, 1:-1]
            rows, columns = known.shape
            if known.size:
                been[down + 1 : down + 1 + rows, right + 1 : right + 1 + columns] = known
        self._been: NDArray[np.bool_] = been
        self.cells = Cells(
            belief=belief.padded.reshape(-1),
            clear=self._clearance.grid.reshape(-1),
            labels=np.zeros(belief.padded.size, dtype=np.uint16),
            been=been.reshape(-1),
            width=shape[1],
        )
        squares = (len(self.layout.y), len(self.layout.x))
        self.dirty, self.beside = np.zeros((2, *squares), dtype=np.bool_)
        self._counts = np.zeros(squares, dtype=np.int32)
        self.first_of = np.full(squares[0] * squares[1], NOWHERE, dtype=np.int32)
        self._resolution = belief.resolution
        self._been_reach = max(round(BEEN_REACH / belief.resolution), 1)
        # The robot is at its viewpoint within half a spacing.
        self._visit_reach = round(spacing / belief.resolution * SUBCELLS) // 2
        self._clear_reach = ceil((radius + MARGIN_REACH) / belief.resolution)
        self._around = nearest_first(self._clear_reach)
        # One subcell of rounding at either end must not cut off a viewpoint that is exactly as far as edges reach.
        self.edge_reach = int(LONGEST_EDGE * spacing / belief.resolution * SUBCELLS) + 2
        side = int(max(np.diff(self.layout.row_begin).max(initial=1), np.diff(self.layout.column_begin).max(initial=1)))
        self._most_touches = side // 2 + 1
        self.pieces = np.zeros(0, dtype=PIECE)
        self._free = np.zeros(0, dtype=np.int32)
        self._free_count = 0
        self.robot = NOWHERE
        self.fresh = self.ended = self._gone = _NO_PIECES
        self.changed: Box = NOTHING_LOST
        self._pairs = (np.zeros(0, np.int32), np.zeros((0, 32), np.int32), np.zeros((0, 32), np.int32))
        self._reached: Reached | None = None
        self._touches = (
            np.zeros((0, 2), np.int32),
            np.zeros((0, 2, self._most_touches), np.int32),
            np.zeros((0, 2, self._most_touches), np.float64),
        )
        self._reserve(64)

    @property
    def used(self) -> int:
        """How many pieces are in use at most: their numbers are below."""
        return len(self.pieces)

    @property
    def edge_lists(self) -> tuple[Pairs, Touches]:
        """All possible edges, connected with the robot or not, as `candidates` and `touches` keep them."""
        return self._pairs, self._touches

    def update(
        self,
        changed: Box | None,
        lost: Box,
        robot: tuple[int, int],
        *,
        remains: Remains = _NOTHING_REMAINS,
        everywhere: bool = False,
        stay: bool = False,
    ) -> None:
        """Bring clear space, pieces, viewpoints and edges up to date.

        Args:
            changed: box of all cells of the belief that changed, whose squares `dirty` names; None for none.
            lost: box of those that are free no more; its second number is -1 when there are none.
            robot: where the robot stands, subcells.
            remains: the frontiers beside which viewpoints move to lookouts; those of pieces where the robot has been,
                unless `everywhere`. All others go back to their usual places, unless they `stay`.
            everywhere: nothing else is left to look at: no piece waits for its lattice point.
            stay: viewpoints at lookouts stay there where the robot has been in their pieces, and where it stands in
                such a piece it has looked around.
        """
        cells, layout = self.cells, self.layout
        self._release()
        box = NOTHING_LOST
        if changed is not None:
            box, lost = self._clearance.update(
                cells.belief.reshape(-1, cells.width), changed, lost, layout, self.dirty, self.beside
            )
            total = int(label_dirty(cells, layout, self.pieces, self.first_of, self.dirty, self.beside, self._counts))
            if total > self._free_count:
                self._reserve(self.used + max(self.used, total))
        self._free_count, self._gone, self.robot, self.fresh, self.ended, most = renew_viewpoints(
            cells, layout, self.pieces, self.first_of, changed is not None, self.dirty, self._counts, self._free,
            self._free_count, self._margin, robot, self._clear_reach, self._visit_reach, everywhere, stay,
            remains, self._around, self._been_reach, self._pairs, self._touches,
        )  # fmt: skip
        self._reserve_pairs(most)
        self.changed = renew_edges(
            cells, layout, self.pieces, self.first_of, box, lost, self.edge_reach, self._pairs, self._touches,
            self.fresh, self.ended, changed or NOTHING_LOST,
        )  # fmt: skip
        if changed is not None or len(self.fresh) or len(self.ended):
            self._reached = None

    def piece_of(self, point: tuple[int, int]) -> int:
        """Return the piece that holds a point, subcells; beside clear space the nearest in a free line; -1 for none."""
        return int(piece_of(self.cells, self.layout, self.pieces, self.first_of, *point, self._clear_reach))

    def pieces_at(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the piece that holds each point, subcells; -1 where none does, int64, shape of ``x``."""
        # Columns of a table, too: the kernel is compiled for one layout.
        places = np.ascontiguousarray(x), np.ascontiguousarray(y)
        found: NDArray[np.int64] = pieces_at(self.cells, self.layout, self.pieces, self.first_of, *places)
        return found

    def reachable(self, piece: int | None = None) -> Reached:
        """Number the viewpoints that edges connect with that of a piece, the robot's where none is given.

        Returns:
            The piece of each node, int32, shape (n,); the node number of each piece, -1 without one, int32, shape
            (used,); and the edges. What was found last is returned again while it holds: do not write to it.
        """
        start = self.robot if piece is None else piece
        if self._reached is None or self._reached[1][start] < 0:
            order, numbers, *edges = reach(
                self.pieces, self.used, self.first_of, start, self._pairs, self._touches, self._resolution
            )
            self._reached = order, numbers, Adjacency(*edges)
        return self._reached

    def way(self, a: int, b: int) -> NDArray[np.int64]:
        """Return the corners of the way between the viewpoints of two pieces that touch, subcells, both ends included.

        The way there and the way back are the same.
        """
        if int(self.pieces[a]["square"]) > int(self.pieces[b]["square"]):
            return self.way(b, a)[::-1]
        corners: NDArray[np.int64] = way_between(self.pieces, self.cells, self.layout, a, b)
        return corners

    def way_within(self, piece: int, start: tuple[int, int], goal: tuple[int, int]) -> NDArray[np.int64]:
        """Return the corners of a way through one piece from one point to another, subcells, both included.

        A point beside clear space is joined to a clear cell nearby.
        """
        p = self.pieces[piece]
        square, label = int(p["square"]), int(p["label"])
        before, after = self._way_in(piece, start), self._way_in(piece, goal)
        corners = way_inside(self.cells, self.layout, square, label, square, label, before[-1], after[-1])
        return np.array([*before[:-1], *corners.tolist(), *after[-2::-1]], dtype=np.int64)

    def _way_in(self, piece: int, point: tuple[int, int]) -> list[tuple[int, int]]:
        """Return the corners of the way from a point into its piece, both included: the point alone if it lies there.

        It comes no nearer to obstacles than the point is, if there is such a way.
        """
        cells = self.cells
        x, y = point[0] >> SUBCELL_BITS, point[1] >> SUBCELL_BITS
        if self._holds(piece, x, y):
            return [point]
        # On the border of cells it belongs to the first of them, see `cell_for`, which may be of another square.
        x, y = (point[0] - 1) >> SUBCELL_BITS, (point[1] - 1) >> SUBCELL_BITS
        if self._holds(piece, x, y):
            return [point, cell_middle(y * cells.width + x, cells.width)]
        return [point, *(cell_middle(cell, cells.width) for cell in way_out(cells, *point, self._clear_reach).tolist())]

    def _holds(self, piece: int, x: int, y: int) -> bool:
        """Whether a cell, column x and row y, is of a piece."""
        p, layout = self.pieces[piece], self.layout
        j, i = divmod(int(p["square"]), len(layout.x))
        rows, columns = layout.row_begin[j : j + 2], layout.column_begin[i : i + 2]
        in_square = rows[0] <= y < rows[1] and columns[0] <= x < columns[1]
        return bool(in_square and self.cells.labels[y * self.cells.width + x] == p["label"])

    def _release(self) -> None:
        """Give the numbers of pieces that ended with the update before to new ones: until now they told what ended."""
        gone, self._gone = self._gone, _NO_PIECES
        if not len(gone):
            return
        self._free[self._free_count : self._free_count + len(gone)] = gone
        self._free_count += len(gone)

    def _reserve(self, capacity: int) -> None:
        """Make room for so many pieces."""
        before = self.used
        self.pieces = _lengthened(self.pieces, capacity)
        self._pairs = (*(_lengthened(column, capacity) for column in self._pairs),)  # type: ignore[assignment]
        self._touches = (*(_lengthened(column, capacity) for column in self._touches),)  # type: ignore[assignment]
        free = np.arange(capacity - 1, before - 1, -1, dtype=np.int32)
        self._free = np.concatenate([free, self._free[: self._free_count], np.zeros(before, dtype=np.int32)])
        self._free_count += len(free)

    def _reserve_pairs(self, most: int) -> None:
        """Make room for so many pairs of one viewpoint."""
        count, other, state = self._pairs
        if most > other.shape[1]:
            wider = np.zeros((2, len(other), max(most, 2 * other.shape[1])), dtype=np.int32)
            wider[0, :, : other.shape[1]], wider[1, :, : other.shape[1]] = other, state
            self._pairs = (count, wider[0], wider[1])


def _lengthened(old: NDArray[Any], length: int) -> NDArray[Any]:
    new = np.zeros((length, *old.shape[1:]), dtype=old.dtype)
    new[: len(old)] = old
    return new

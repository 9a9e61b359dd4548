"""Touching pieces: which pieces of neighbouring squares share a border that the robot can cross, and the way there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.candidates import IN_LINE
from common.mapping.pieces import Cells
from common.mapping.squares import Layout
from common.mapping.ways import length_of, way_between
from common.system.jit import njit


@njit(cache=True, nogil=True)
def _by_label(pieces: Any, first: int, labels: NDArray[np.int32]) -> None:
    """Write the piece of each number of a square."""
    while first >= 0:
        labels[pieces[first].label] = first
        first = pieces[first].next


@njit(cache=True, nogil=True)
def find_touches(
    cells: Cells,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    dirty: NDArray[np.bool_],
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    length: NDArray[np.float64],
) -> None:
    """Find anew which pieces touch across the borders of dirty squares.

    Args:
        cells: of the belief.
        pieces: all pieces.
        first_of: first piece of each square.
        layout: of the squares.
        dirty: squares whose pieces may be others than before, bool, shape (rows, columns).
        count: number of touched pieces of the square to the right and of the one above, int32, shape (pieces, 2).
        other: those pieces, int32, shape (pieces, 2, most).
        length: of the way to them, subcells, NaN while not worked out, float64, same shape.
    """
    width = cells.width
    rows, columns = len(layout.y), len(layout.x)
    most = 2 * other.shape[2]
    here_of = np.empty(most * most + 1, dtype=np.int32)
    there_of = np.empty(most * most + 1, dtype=np.int32)
    for j in range(rows):
        for i in range(columns):
            for side in range(2):
                to_j, to_i = j + side, i + 1 - side
                inside = to_j < rows and to_i < columns
                if not dirty[j, i] and not (inside and dirty[to_j, to_i]):
                    continue
                first = first_of[j * columns + i]
                second = first_of[to_j * columns + to_i] if inside else -1
                piece = first
                while piece >= 0:
                    count[piece, side] = 0
                    piece = pieces[piece].next
                if first < 0 or second < 0:
                    continue
                _by_label(pieces, first, here_of)
                _by_label(pieces, second, there_of)
                if side == 0:
                    cell = layout.row_begin[j] * width + layout.column_begin[to_i] - 1
                    steps, along, across = layout.row_begin[j + 1] - layout.row_begin[j], width, 1
                else:
                    cell = (layout.row_begin[to_j] - 1) * width + layout.column_begin[i]
                    steps, along, across = layout.column_begin[i + 1] - layout.column_begin[i], 1, width
                for _ in range(steps):
                    a, b = cells.labels[cell], cells.labels[cell + across]
                    cell += along
                    if a == 0 or b == 0:
                        continue
                    piece, touched = here_of[a], there_of[b]
                    n = count[piece, side]
                    known = False
                    for k in range(n):
                        known |= other[piece, side, k] == touched
                    if not known:
                        other[piece, side, n] = touched
                        length[piece, side, n] = np.nan
                        count[piece, side] = n + 1


@njit(cache=True, nogil=True)
def forget_ways(
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    moved: NDArray[np.int32],
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    length: NDArray[np.float64],
) -> None:
    """Forget the lengths of the ways from and to viewpoints that have moved; arguments as `find_touches` has them."""
    columns = len(layout.x)
    for piece in moved:
        length[piece] = np.nan
        j, i = pieces[piece].square // columns, pieces[piece].square % columns
        for side in range(2):
            from_j, from_i = j - side, i - 1 + side
            if from_j < 0 or from_i < 0:
                continue
            there = first_of[from_j * columns + from_i]
            while there >= 0:
                for k in range(count[there, side]):
                    if other[there, side, k] == piece:
                        length[there, side, k] = np.nan
                there = pieces[there].next


@njit(cache=True, nogil=True)
def measure_ways(
    cells: Cells,
    pieces: Any,
    used: int,
    layout: Layout,
    pairs: NDArray[np.int32],
    pair_other: NDArray[np.int32],
    pair_state: NDArray[np.int32],
    count: NDArray[np.int32],
    other: NDArray[np.int32],
    length: NDArray[np.float64],
) -> None:
    """Work out the ways between viewpoints of touching pieces that no straight edge joins, where they are not known.

    A way depends on the two pieces alone, so it is known as long as `find_touches` does not look at them again. Where a
    straight edge does its work the length is infinite: the pair is no edge.

    Args:
        cells: of the belief.
        pieces: all pieces.
        used: how many of them are in use at most.
        layout: of the squares.
        pairs: length of the lists of possible straight edges, see `common.mapping.candidates`.
        pair_other: second viewpoints of those.
        pair_state: their states.
        count: see `find_touches`.
        other: see `find_touches`.
        length: brought up to date.
    """
    for piece in range(used):
        if not pieces[piece].exists:
            continue
        for side in range(2):
            for k in range(count[piece, side]):
                there = other[piece, side, k]
                if not pieces[there].exists:
                    continue
                straight = False
                for c in range(pairs[piece]):
                    straight |= pair_other[piece, c] == there and pair_state[piece, c] == IN_LINE
                if straight:
                    length[piece, side, k] = np.inf
                elif not np.isfinite(length[piece, side, k]):
                    length[piece, side, k] = length_of(way_between(pieces, cells, layout, piece, np.int64(there)))

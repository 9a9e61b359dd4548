"""Settling squares after a change: which pieces they hold, which of these have a viewpoint, and where."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.pieces import NOWHERE, Cells, best_place, centre_label, label_square, survey
from common.mapping.squares import Layout
from common.system.jit import njit


@njit(cache=True, nogil=True)
def label_dirty(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    dirty: NDArray[np.bool_],
    beside: NDArray[np.bool_],
    counts: NDArray[np.int32],
) -> int:
    """Number the pieces of all dirty squares; write how many each has; return how many they have together.

    Those squares become dirty as well whose viewpoints may have to move for what changed beside them.
    """
    rows, columns = dirty.shape
    stack = np.empty(_largest(layout.row_begin) * _largest(layout.column_begin), dtype=np.int32)
    total = 0
    for j in range(rows):
        for i in range(columns):
            if beside[j, i]:
                beside[j, i] = False
                piece = first_of[j * columns + i]
                while piece >= 0:
                    dirty[j, i] |= pieces[piece].x >= 0 and not pieces[piece].centred
                    piece = pieces[piece].next
            if dirty[j, i]:
                counts[j, i] = label_square(cells, layout, j, i, stack)
                total += counts[j, i]
    return total


@njit(cache=True, nogil=True)
def _largest(begin: NDArray[np.int64]) -> int:
    most = 1
    for k in range(len(begin) - 1):
        most = max(most, begin[k + 1] - begin[k])
    return most


@njit(cache=True, nogil=True)
def settle(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    dirty: NDArray[np.bool_],
    counts: NDArray[np.int32],
    free: NDArray[np.int32],
    free_count: int,
    margin: int,
    gone: NDArray[np.int32],
) -> tuple[int, int]:
    """Make the pieces of all dirty squares anew; one whose viewpoint stays where it was stays the piece that it was.

    Args:
        cells: of the belief, labelled.
        layout: of the squares.
        pieces: all pieces.
        first_of: first piece of each square.
        dirty: squares to look at.
        counts: number of pieces of each square.
        free: numbers of pieces that are not in use, a stack; there are enough.
        free_count: height of the stack.
        margin: space around a place that counts at most, cells.
        gone: receives the pieces that are no more.

    Returns:
        Height of the stack, and how many pieces are gone.
    """
    rows, columns = dirty.shape
    gone_count = 0
    most = 1
    for j in range(rows):
        for i in range(columns):
            if dirty[j, i]:
                most = max(most, counts[j, i] + 1)
    first_cell = np.empty(most, dtype=np.int32)
    visited = np.empty(most, dtype=np.bool_)
    for j in range(rows):
        for i in range(columns):
            if not dirty[j, i]:
                continue
            square = j * columns + i
            old = first_of[square]
            count = counts[j, i]
            first_of[square] = NOWHERE
            if count:
                first_cell[: count + 1] = -1
                visited[: count + 1] = False
                settled = survey(cells, layout, j, i, first_cell[: count + 1], visited)
                centre = centre_label(cells, layout, j, i)
                last = NOWHERE
                for label in range(1, count + 1):
                    x, y = np.int64(NOWHERE), np.int64(NOWHERE)
                    waits = not (settled or label == centre)
                    if label == centre:
                        x, y = layout.x[i], layout.y[j]
                    elif settled or visited[label]:
                        x, y = best_place(cells, layout, j, i, label, margin)
                    # The same viewpoint as before, if there was one at this place.
                    before, piece = NOWHERE, old
                    while piece >= 0 and (x < 0 or pieces[piece].x != x or pieces[piece].y != y):
                        before, piece = piece, pieces[piece].next
                    if piece >= 0:
                        after = pieces[piece].next
                        if before < 0:
                            old = after
                        else:
                            pieces[before].next = after
                    else:
                        free_count -= 1
                        piece = free[free_count]
                        pieces[piece].exists = False
                        pieces[piece].listed = False
                    p = pieces[piece]
                    p.x, p.y, p.square, p.label, p.next = x, y, square, label, NOWHERE
                    p.cell, p.alive, p.centred, p.waits = first_cell[label], True, label == centre, waits
                    p.visited, p.lookout = visited[label], False
                    if last < 0:
                        first_of[square] = piece
                    else:
                        pieces[last].next = piece
                    last = piece
            while old >= 0:
                pieces[old].alive = False
                gone[gone_count] = old
                gone_count += 1
                old = pieces[old].next
    return free_count, gone_count


@njit(cache=True, nogil=True)
def usual_place(cells: Cells, layout: Layout, pieces: Any, piece: int, margin: int) -> tuple[np.int64, np.int64]:
    """Return where the viewpoint of a piece is unless it is at a lookout, subcells."""
    p = pieces[piece]
    if p.x >= 0 and not p.lookout:
        return p.x, p.y
    j, i = p.square // len(layout.x), p.square % len(layout.x)
    if p.centred:
        return layout.x[i], layout.y[j]
    return best_place(cells, layout, j, i, np.int64(p.label), margin)


@njit(cache=True, nogil=True)
def choose(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    used: int,
    touch_count: NDArray[np.int32],
    touch_other: NDArray[np.int32],
    robot: int,
    everywhere: bool,
    lookouts: NDArray[np.int64],
    stay: bool,
    margin: int,
    fresh: NDArray[np.int32],
    ended: NDArray[np.int32],
) -> tuple[int, int]:
    """Decide which pieces have a viewpoint, and give those that are new a place; see `ViewpointGraph`.

    Args:
        cells: of the belief.
        layout: of the squares.
        pieces: all pieces; brought up to date.
        used: how many of them are in use at most.
        touch_count: see `find_touches`.
        touch_other: see `find_touches`.
        robot: piece where the robot stands, -1 for none.
        everywhere: no piece waits.
        lookouts: place of each piece near frontiers, subcells, int64, shape (used, 2); -1 for its usual one.
        stay: viewpoints at lookouts stay there where the robot has been in their pieces.
        margin: space around a place that counts at most, cells.
        fresh: receives the pieces whose viewpoint is new, int32.
        ended: receives the living pieces whose viewpoint ends, int32.

    Returns:
        How many of either.
    """
    beside = np.zeros(used, dtype=np.bool_)
    for piece in range(used):
        if not pieces[piece].alive:
            continue
        for side in range(2):
            for k in range(touch_count[piece, side]):
                there = touch_other[piece, side, k]
                if pieces[piece].visited:
                    beside[there] = True
                if pieces[there].visited:
                    beside[piece] = True
    fresh_count = ended_count = 0
    for piece in range(used):
        p = pieces[piece]
        if not p.alive:
            continue
        exists = not p.waits or p.visited or beside[piece] or piece == robot or everywhere
        x, y = lookouts[piece, 0], lookouts[piece, 1]
        if stay and p.lookout and p.visited:
            x, y = p.x, p.y
        is_lookout = x >= 0
        if not is_lookout and (exists or p.lookout):
            # Nearly all stay where they are; handing all arrays over to find that out is what would take time.
            x, y = p.x, p.y
            if p.x < 0 or p.lookout:
                x, y = usual_place(cells, layout, pieces, piece, margin)
        moves = x >= 0 and (x != p.x or y != p.y)
        if p.exists and (moves or not exists):
            ended[ended_count] = piece
            ended_count += 1
        if exists and (moves or not p.exists):
            fresh[fresh_count] = piece
            fresh_count += 1
        if moves:
            p.x, p.y = x, y
        p.lookout = is_lookout
        p.exists = exists
    return fresh_count, ended_count

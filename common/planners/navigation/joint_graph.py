"""From two viewpoint graphs to one: which vertices they have in common, and the edges of both as rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.candidates import IN_LINE, REACH_SQUARES
from common.mapping.pieces import Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS
from common.mapping.renewal import Pairs, Touches
from common.mapping.sight import CLEAR, FREE, blocker
from common.mapping.squares import Layout
from common.planners.navigation.graph_search import NO_WAY, find_place, straight_length
from common.system.copies import copy_rows
from common.system.jit import njit

Place = tuple[int, int]


def merge_places(
    x: NDArray[np.int64], y: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
    """Return x and y of all different places, ascending by y, then by x, and the number of each given one."""
    # One number tells a place: grids have no more than 2^28 cells, of 2^32 subcells each.
    low = int(x.min())
    keys = (y - int(y.min())) * (int(x.max()) - low + 1) + (x - low)
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    new = np.ones(len(order), dtype=np.bool_)
    np.not_equal(ordered[1:], ordered[:-1], out=new[1:])
    numbers = np.empty(len(order), dtype=np.int32)
    numbers[order] = np.cumsum(new, dtype=np.int32) - 1
    first = order[new]
    return x[first], y[first], numbers


@njit(cache=True, nogil=True)
def flags_at(x: NDArray[np.int64], y: NDArray[np.int64], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which vertices lie at some of the places, bool."""
    flags = np.zeros(len(x), dtype=np.bool_)
    for k in range(len(places)):
        node = find_place(x, y, places[k, 0], places[k, 1])
        if node >= 0:
            flags[node] = True
    return flags


@njit(cache=True, nogil=True)
def links_between(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    possible: NDArray[np.int32],
    known: NDArray[np.int32],
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    corner: Place,
    shut: NDArray[np.bool_],
    reach: int,
) -> NDArray[np.int32]:
    """Join known viewpoints that are no possible ones with the possible viewpoint of their piece, and those around it.

    Args:
        cells: of the world at its best.
        layout: of its squares.
        pieces: of its graph.
        first_of: first piece of each square.
        possible: vertex of each piece, -1 without one.
        known: vertex of each known viewpoint.
        x: of the vertices, subcells.
        y: likewise.
        corner: what to take from that for subcells of the padded grid.
        shut: vertices that may not be joined.
        reach: the longest straight edge, subcells.

    Returns:
        Pairs of vertices, int32, shape (m, 2).
    """
    width = cells.width
    rows, columns = len(layout.y), len(layout.x)
    is_possible = np.zeros(len(x), dtype=np.bool_)
    for vertex in possible:
        if vertex >= 0:
            is_possible[vertex] = True
    links = np.empty((64, 2), dtype=np.int32)
    count = 0
    for vertex in known:
        if is_possible[vertex] or shut[vertex]:
            continue
        x0, y0 = x[vertex] - corner[0], y[vertex] - corner[1]
        own = piece_at(pieces, first_of, cells, layout, (y0 >> SUBCELL_BITS) * width + (x0 >> SUBCELL_BITS))
        if own < 0:
            continue
        j, i = pieces[own].square // columns, pieces[own].square % columns
        for row in range(max(j - REACH_SQUARES, 0), min(j + REACH_SQUARES, rows - 1) + 1):
            for column in range(max(i - REACH_SQUARES, 0), min(i + REACH_SQUARES, columns - 1) + 1):
                piece = first_of[row * columns + column]
                while piece >= 0:
                    there = possible[piece]
                    x1, y1 = pieces[piece].x, pieces[piece].y
                    if (
                        there >= 0
                        and not shut[there]
                        and (
                            piece == own
                            or (
                                (x1 - x0) ** 2 + (y1 - y0) ** 2 <= reach * reach
                                and blocker(cells.clear, width, x0, y0, x1, y1) == CLEAR
                            )
                        )
                    ):
                        if count == len(links):
                            more = np.empty((2 * count, 2), dtype=np.int32)
                            copy_rows(more, links)
                            links = more
                        links[count, 0], links[count, 1] = vertex, there
                        count += 1
                    piece = pieces[piece].next
    return links[:count].copy()


@njit(cache=True, nogil=True)
def seen_pieces(
    cells: Cells, layout: Layout, pieces: Any, touches: Touches, known: NDArray[np.int8], down: int, right: int
) -> NDArray[np.bool_]:
    """Return which pieces with bent edges have a cell that is known to be free.

    Args:
        cells: of the world at its best.
        layout: of its squares.
        pieces: of its graph.
        touches: count, other and length of touching pieces, see `common.mapping.touches`.
        known: padded grid of the belief.
        down: rows of ``cells`` before those of ``known``.
        right: columns of ``cells`` before those of ``known``.
    """
    count, other, length = touches
    seen = np.zeros(len(pieces), dtype=np.bool_)
    asked = np.zeros(len(pieces), dtype=np.bool_)
    columns = len(layout.x)
    height, width = known.shape
    for piece in range(len(pieces)):
        for side in range(2):
            for k in range(count[piece, side]):
                if np.isfinite(length[piece, side, k]):
                    asked[piece] = asked[other[piece, side, k]] = True
    for piece in range(len(pieces)):
        if not (asked[piece] and pieces[piece].exists):
            continue
        p = pieces[piece]
        j, i = p.square // columns, p.square % columns
        left, end = max(layout.column_begin[i], right), min(layout.column_begin[i + 1], right + width)
        for row in range(max(layout.row_begin[j], down), min(layout.row_begin[j + 1], down + height)):
            for column in range(left, end):
                if known[row - down, column - right] == FREE and cells.labels[row * cells.width + column] == p.label:
                    seen[piece] = True
                    break
            if seen[piece]:
                break
    return seen


@njit(cache=True, nogil=True, inline="always")
def _enter(
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    u: int,
    v: int,
    least: float,
    end: NDArray[np.int64],
    ends: NDArray[np.int32],
    lengths: NDArray[np.int64],
) -> None:
    """Write an edge, which is as long as the straight line, but at least some subcells, into the rows of both ends."""
    length = straight_length(x[v] - x[u], y[v] - y[u])
    if least > 0.0:
        length = max(length, np.int64(np.ceil(least)))
    ends[end[u]], lengths[end[u]] = v, length
    ends[end[v]], lengths[end[v]] = u, length
    end[u] += 1
    end[v] += 1


@njit(cache=True, nogil=True)
def edge_rows(
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    scanned: NDArray[np.bool_],
    closed: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    possible: NDArray[np.int32],
    pairs: Pairs,
    touches: Touches,
    known: NDArray[np.int32],
    known_edges: tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]],
    links: NDArray[np.int32],
    scale: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int64]]:
    """Collect all edges as `GoalGraph` wants them.

    Possible edges count between vertices that were not scanned from, bent ones between pieces that were seen; known
    ones always; none at closed vertices.

    Args:
        x: of the vertices, subcells.
        y: likewise.
        scanned: vertices that the robot has scanned from.
        closed: vertices that it does not get to.
        seen: pieces of the world at its best of which something was seen.
        possible: vertex of each of these pieces, -1 without one.
        pairs: count, other and state of possible straight edges, see `common.mapping.candidates`.
        touches: count, other and length of touching pieces, subcells, see `common.mapping.touches`.
        known: vertex of each known viewpoint.
        known_edges: of these, as `Adjacency` has them.
        links: pairs of vertices that straight edges join as well.
        scale: subcells per metre.
    """
    n = len(x)
    pair_count, pair_other, pair_state = pairs
    touch_count, touch_other, touch_length = touches
    pointer, neighbours, metres, bent = known_edges
    # Room for all edges; then those that count, in any order.
    begin = np.zeros(n + 1, dtype=np.int64)
    for piece in range(len(possible)):
        u = possible[piece]
        if u < 0:
            continue
        begin[u + 1] += pair_count[piece] + touch_count[piece, 0] + touch_count[piece, 1]
        for k in range(pair_count[piece]):
            begin[possible[pair_other[piece, k]] + 1] += 1
        for side in range(2):
            for k in range(touch_count[piece, side]):
                begin[possible[touch_other[piece, side, k]] + 1] += 1
    begin[0] = 0
    for node in range(len(known)):
        begin[known[node] + 1] += pointer[node + 1] - pointer[node]
    for k in range(len(links)):
        begin[links[k, 0] + 1] += 1
        begin[links[k, 1] + 1] += 1
    for u in range(n):
        begin[u + 1] += begin[u]
    end = begin[:n].copy()
    ends = np.empty(begin[n], dtype=np.int32)
    lengths = np.empty(begin[n], dtype=np.int64)
    for piece in range(len(possible)):
        u = possible[piece]
        if u < 0 or closed[u] or scanned[u]:
            continue
        for k in range(pair_count[piece]):
            if pair_state[piece, k] == IN_LINE:
                v = possible[pair_other[piece, k]]
                if not (closed[v] or scanned[v]):
                    _enter(x, y, u, v, 0.0, end, ends, lengths)
        if not seen[piece]:
            continue
        for side in range(2):
            for k in range(touch_count[piece, side]):
                there = touch_other[piece, side, k]
                v = possible[there]
                length = touch_length[piece, side, k]
                if v >= 0 and seen[there] and np.isfinite(length) and not (closed[v] or scanned[v]):
                    _enter(x, y, u, v, length, end, ends, lengths)
    for node in range(len(known)):
        u = known[node]
        for k in range(pointer[node], pointer[node + 1]):
            v = known[neighbours[k]]
            if neighbours[k] > node and not (closed[u] or closed[v]):
                _enter(x, y, u, v, metres[k] * scale if bent[k] else 0.0, end, ends, lengths)
    for k in range(len(links)):
        _enter(x, y, links[k, 0], links[k, 1], 0.0, end, ends, lengths)
    # Walking the vertices in order and noting each with its neighbours sorts every row; of several edges between two
    # vertices the shortest remains.
    place = begin[:n].copy()
    rows = np.empty(begin[n], dtype=np.int32)
    costs = np.empty(begin[n], dtype=np.int64)
    for u in range(n):
        for k in range(begin[u], end[u]):
            v = ends[k]
            last = place[v] - 1
            if last >= begin[v] and rows[last] == u:
                costs[last] = min(costs[last], lengths[k])
            else:
                rows[last + 1], costs[last + 1] = u, lengths[k]
                place[v] = last + 2
    out = np.zeros(n + 1, dtype=np.int64)
    size = 0
    for u in range(n):
        for k in range(begin[u], place[u]):
            rows[size], costs[size] = rows[k], costs[k]
            size += 1
        out[u + 1] = size
    return out, rows[:size].copy(), costs[:size].copy()


@njit(cache=True, nogil=True)
def straight_legs(
    cells: NDArray[np.int8],
    width: int,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    corner: Place,
    shut: NDArray[np.bool_],
    target: Place,
    reach: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return straight distances to the target, and last legs: those in reach that touch only clear cells."""
    n = len(x)
    straight = np.empty(n, dtype=np.int64)
    legs = np.full(n, NO_WAY, dtype=np.int64)
    for node in range(n):
        dx, dy = x[node] - target[0], y[node] - target[1]
        straight[node] = straight_length(dx, dy)
        if not shut[node] and straight[node] <= reach:
            x0, y0 = x[node] - corner[0], y[node] - corner[1]
            if blocker(cells, width, x0, y0, x0 - dx, y0 - dy) == CLEAR:
                legs[node] = straight[node]
    return straight, legs

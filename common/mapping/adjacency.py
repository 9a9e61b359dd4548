"""The graph's edges as rows of neighbours: of all viewpoints, and of those that the robot can reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.candidates import IN_LINE
from common.mapping.raycast import SUBCELLS
from common.system.jit import njit


@dataclass(frozen=True, slots=True, eq=False)
class Adjacency:
    """Neighbours of each node, ascending, of one node behind the other's.

    Attributes:
        pointer: first entry of each node, then their number, int64, shape (n + 1,).
        neighbours: node numbers, int32, shape (2 * edges,).
        lengths: of the ways there, metres, float64, same shape.
        bent: the way there is not the straight line, bool, same shape.
    """

    pointer: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    lengths: NDArray[np.float64]
    bent: NDArray[np.bool_]

    def of(self, node: int) -> NDArray[np.int32]:
        """Return the neighbours of a node, ascending."""
        return self.neighbours[self.pointer[node] : self.pointer[node + 1]]


@njit(cache=True, nogil=True, inline="always")
def _enter(
    begin: NDArray[np.int64],
    ends: NDArray[np.int32],
    lengths: NDArray[np.float64],
    bent: NDArray[np.bool_],
    piece: int,
    there: int,
    length: float,
    is_bent: bool,
) -> None:
    """Write an edge into the row of one of its ends."""
    k = begin[piece]
    ends[k], lengths[k], bent[k] = there, length, is_bent
    begin[piece] = k + 1


@njit(cache=True, nogil=True)
def reach(
    pieces: Any,
    used: int,
    first_of: NDArray[np.int32],
    start: int,
    pairs: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]],
    touches: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]],
    resolution: float,
) -> tuple[
    NDArray[np.int32],
    NDArray[np.int32],
    NDArray[np.int64],
    NDArray[np.int32],
    NDArray[np.float64],
    NDArray[np.bool_],
]:
    """Number the viewpoints that edges connect with one, and collect their edges.

    Nodes are numbered row-major by square, then in the order of the pieces of a square.

    Args:
        pieces: all pieces.
        used: how many of them are in use at most.
        first_of: first piece of each square.
        start: the piece where to begin.
        pairs: count, other and state of possible straight edges, see `common.mapping.candidates`.
        touches: count, other and length of touching pieces, see `common.mapping.touches`.
        resolution: metres per cell.

    Returns:
        The piece of each node, int32, shape (n,); the node number of each piece, -1 without one, int32, shape (used,);
        and the edges as `Adjacency` describes them.
    """
    pair_count, pair_other, pair_state = pairs
    touch_count, touch_other, touch_length = touches
    # Edges of all viewpoints, each twice.
    begin = np.zeros(used + 1, dtype=np.int64)
    for fill in range(2):
        if fill:
            total = np.int64(0)
            for piece in range(used + 1):
                degree = begin[piece]
                begin[piece] = total
                total += degree
            ends = np.empty(total, dtype=np.int32)
            lengths = np.empty(total)
            bent = np.empty(total, dtype=np.bool_)
        for piece in range(used):
            if not pieces[piece].exists:
                continue
            for k in range(pair_count[piece]):
                if pair_state[piece, k] == IN_LINE:
                    there = pair_other[piece, k]
                    if fill:
                        dx = float(pieces[there].x - pieces[piece].x)
                        dy = float(pieces[there].y - pieces[piece].y)
                        length = np.sqrt(dx * dx + dy * dy) / SUBCELLS * resolution
                        _enter(begin, ends, lengths, bent, piece, there, length, False)
                        _enter(begin, ends, lengths, bent, there, piece, length, False)
                    else:
                        begin[piece] += 1
                        begin[there] += 1
            for side in range(2):
                for k in range(touch_count[piece, side]):
                    there = touch_other[piece, side, k]
                    if pieces[there].exists and np.isfinite(touch_length[piece, side, k]):
                        if fill:
                            length = touch_length[piece, side, k] / SUBCELLS * resolution
                            _enter(begin, ends, lengths, bent, piece, there, length, True)
                            _enter(begin, ends, lengths, bent, there, piece, length, True)
                        else:
                            begin[piece] += 1
                            begin[there] += 1
    # Filling moved each beginning to the next one's place.
    numbers = np.full(used, -1, dtype=np.int32)
    stack = np.empty(used, dtype=np.int32)
    stack[0] = start
    numbers[start] = 0
    size = 1
    n = 1
    while size:
        size -= 1
        piece = stack[size]
        for k in range(begin[piece - 1] if piece else 0, begin[piece]):
            if numbers[ends[k]] < 0:
                numbers[ends[k]] = 0
                stack[size] = ends[k]
                size += 1
                n += 1
    order = np.empty(n, dtype=np.int32)
    at = 0
    for square in range(len(first_of)):
        piece = first_of[square]
        while piece >= 0:
            if numbers[piece] == 0:
                order[at] = piece
                at += 1
            piece = pieces[piece].next
    for node in range(n):
        numbers[order[node]] = node
    pointer = np.zeros(n + 1, dtype=np.int64)
    for node in range(n):
        piece = order[node]
        pointer[node + 1] = pointer[node] + begin[piece] - (begin[piece - 1] if piece else 0)
    # Walking the nodes in order and noting each with its neighbours sorts every row.
    filled = pointer[:-1].copy()
    neighbours = np.empty(pointer[n], dtype=np.int32)
    out_lengths = np.empty(pointer[n])
    out_bent = np.empty(pointer[n], dtype=np.bool_)
    for node in range(n):
        piece = order[node]
        for k in range(begin[piece - 1] if piece else 0, begin[piece]):
            other = numbers[ends[k]]
            place = filled[other]
            neighbours[place], out_lengths[place], out_bent[place] = node, lengths[k], bent[k]
            filled[other] += 1
    return order, numbers, pointer, neighbours, out_lengths, out_bent

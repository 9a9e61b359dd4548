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


@njit(cache=True, nogil=True)
def _number_all(pieces: Any, first_of: NDArray[np.int32], numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number all viewpoints row-major by square, then in the order of the pieces of a square; return their pieces."""
    ordered = np.empty(len(numbers), dtype=np.int32)
    n = 0
    for first in first_of:
        piece = first
        while piece >= 0:
            if pieces[piece].exists:
                ordered[n] = piece
                numbers[piece] = n
                n += 1
            piece = pieces[piece].next
    return ordered[:n]


@njit(cache=True, nogil=True, inline="always")
def _root(parent: NDArray[np.int32], node: int) -> int:
    """Return the node that stands for all that are connected with one, and shorten the way there."""
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


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
    numbers = np.full(used, -1, dtype=np.int32)
    ordered = _number_all(pieces, first_of, numbers)
    every = len(ordered)
    most = 0
    for piece in ordered:
        most += pair_count[piece] + touch_count[piece, 0] + touch_count[piece, 1]
    # Every edge stands with its end that comes first: listed in that order, and once.
    low = np.empty(most, dtype=np.int32)
    high = np.empty(most, dtype=np.int32)
    far = np.empty(most)
    bends = np.empty(most, dtype=np.bool_)
    parent = np.arange(every).astype(np.int32)
    edges = 0
    for here in range(every):
        piece = ordered[here]
        begin = edges
        x, y = pieces[piece].x, pieces[piece].y
        for k in range(pair_count[piece]):
            if pair_state[piece, k] == IN_LINE:
                there = pair_other[piece, k]
                dx, dy = float(pieces[there].x - x), float(pieces[there].y - y)
                high[edges], bends[edges] = numbers[there], False
                far[edges] = np.sqrt(dx * dx + dy * dy) / SUBCELLS * resolution
                edges += 1
        for side in range(2):
            for k in range(touch_count[piece, side]):
                there = touch_other[piece, side, k]
                if numbers[there] >= 0 and np.isfinite(touch_length[piece, side, k]):
                    high[edges], bends[edges] = numbers[there], True
                    far[edges] = touch_length[piece, side, k] / SUBCELLS * resolution
                    edges += 1
        root = _root(parent, here)
        for e in range(begin, edges):
            low[e] = here
            other = _root(parent, high[e])
            parent[max(root, other)] = root = min(root, other)

    # The lowest of connected nodes stands for them; the ones connected with the start keep their order.
    node_of = np.full(every, -1, dtype=np.int32)
    order = np.empty(every, dtype=np.int32)
    home = _root(parent, numbers[start])
    numbers[:] = -1
    n = 0
    for here in range(every):
        if _root(parent, here) == home:
            order[n] = ordered[here]
            node_of[here] = numbers[ordered[here]] = n
            n += 1
    # How many neighbours each node has before it, and in all.
    before = np.zeros(n, dtype=np.int64)
    pointer = np.zeros(n + 1, dtype=np.int64)
    for e in range(edges):
        if node_of[low[e]] >= 0:
            a, b = node_of[low[e]], node_of[high[e]]
            before[b] += 1
            pointer[a + 1] += 1
            pointer[b + 1] += 1
    for node in range(n):
        pointer[node + 1] += pointer[node]
    neighbours = np.empty(pointer[n], dtype=np.int32)
    lengths = np.empty(pointer[n])
    bent = np.empty(pointer[n], dtype=np.bool_)
    # In the order of the edges, each row gets those before its node ascending.
    place = pointer[:-1].copy()
    for e in range(edges):
        if node_of[low[e]] >= 0:
            a, b = node_of[low[e]], node_of[high[e]]
            at = place[b]
            neighbours[at], lengths[at], bent[at] = a, far[e], bends[e]
            place[b] = at + 1
    # Then, node after node, each enters itself with those behind which it comes.
    for b in range(n):
        for k in range(pointer[b], pointer[b] + before[b]):
            a = neighbours[k]
            at = place[a]
            neighbours[at], lengths[at], bent[at] = b, lengths[k], bent[k]
            place[a] = at + 1
    return order[:n].copy(), numbers, pointer, neighbours, lengths, bent

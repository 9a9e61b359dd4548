"""Path lengths between some of the viewpoints, for tours that need few of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.adjacency import Adjacency
from common.system.jit import njit


class _Graph(NamedTuple):
    """The edges of the viewpoints by node: first entry of each, shape (n + 1,), the neighbours and their distances."""

    pointer: NDArray[np.int64]
    neighbour: NDArray[np.int32]
    length: NDArray[np.float32]


class _Known(NamedTuple):
    """Path lengths from some nodes to all: the row of each node, -1 without one, shape (n,), and the rows."""

    row_of: NDArray[np.int32]
    rows: NDArray[np.float32]


class Paths:
    """Path lengths from the viewpoints that are asked for to all others, kept from one decision to the next.

    From one decision to the next the graph changes only near the robot, and most of a tour's stops stay. So the rows of
    the last decision are mended where the graph has changed instead of being searched anew; a row that nobody asks for
    is forgotten with the next update. Lengths are the same as those of a search, to the last bit.
    """

    def __init__(self) -> None:
        """Know of no viewpoint yet."""
        self._keys = np.empty(0, dtype=np.int64)
        self._graph = _Graph(np.zeros(1, np.int64), np.empty(0, np.int32), np.empty(0, np.float32))
        self._known = _nothing_known(0)

    def update(self, positions: NDArray[np.float64], edges: Adjacency) -> None:
        """Take another graph; node numbers are those of this one from now on.

        Args:
            positions: of its viewpoints, metres, shape (n, 2).
            edges: between them; they count as straight lines, as they nearly are.
        """
        before, self._before = self._graph, self._known
        keys = place_keys(positions)
        self._graph = _Graph(edges.pointer, edges.neighbours, _straight(edges.pointer, edges.neighbours, positions))
        self._earlier = _find(self._keys, keys)
        self._changed = _changed_nodes(before, self._graph, self._earlier)
        self._keys = keys
        self._known = _nothing_known(len(keys))
        self._count = 0

    def look_up(self, nodes: NDArray[np.int64]) -> _Known:
        """Return the rows of some nodes, each given once, among others."""
        missing = nodes[self._known.row_of[nodes] < 0]
        if len(missing):
            total = self._count + len(missing)
            if total > len(self._known.rows):
                rows = np.empty((max(64, 2 * total), len(self._keys)), dtype=np.float32)
                rows[: self._count] = self._known.rows[: self._count]
                self._known = _Known(self._known.row_of, rows)
            _extend(self._graph, self._before, self._earlier, self._changed, missing, self._known, self._count)
            self._count = total
        return self._known


class Ways:
    """Path lengths between some nodes, looked up row by row.

    A search from every viewpoint of a large building would take a second, and a tour asks for the ways from its stops
    alone. What was not looked up yet is infinite, so that no move of a tour is made for it.

    Attributes:
        nodes: node numbers; other arrays and arguments count places in these, int64, shape (n,).
        lengths: metres, symmetric, float32, shape (n, n); infinite where no way is known.
    """

    def __init__(self, paths: Paths, nodes: NDArray[np.int64]) -> None:
        """Know of no way yet."""
        self.nodes = nodes
        self.lengths = np.full((len(nodes), len(nodes)), np.inf, dtype=np.float32)
        self._paths = paths
        self._known = np.zeros(len(nodes), dtype=np.bool_)

    def look_up(self, places: NDArray[np.int64]) -> None:
        """Make sure that the ways between some places and all others are known."""
        new = places[~self._known[places]]
        if len(new):
            new = np.unique(new)
            _enter(self._paths.look_up(self.nodes[new]), self.nodes, new, self.lengths)
            self._known[new] = True


def place_keys(positions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return a number for each position that tells places a millimetre apart, whatever the update."""
    millimetres = np.rint(positions * 1e3).astype(np.int64)
    return np.asarray((millimetres[:, 0] << 32) + millimetres[:, 1])


def _nothing_known(nodes: int) -> _Known:
    return _Known(np.full(nodes, -1, dtype=np.int32), np.empty((0, nodes), dtype=np.float32))


def _find(keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return where each wanted key stands among some keys, -1 where it does not, int32."""
    if not len(keys):
        return np.full(len(wanted), -1, dtype=np.int32)
    order = np.argsort(keys)
    place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    return np.where(keys[place] == wanted, place, -1).astype(np.int32)


@njit(cache=True, nogil=True)
def _straight(
    pointer: NDArray[np.int64], neighbour: NDArray[np.int32], positions: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the distance between the ends of each edge, metres."""
    length = np.empty(len(neighbour), dtype=np.float32)
    for node in range(len(pointer) - 1):
        for k in range(pointer[node], pointer[node + 1]):
            there = neighbour[k]
            length[k] = np.hypot(positions[there, 0] - positions[node, 0], positions[there, 1] - positions[node, 1])
    return length


@njit(cache=True, nogil=True)
def _changed_nodes(before: _Graph, after: _Graph, earlier: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the nodes that are new or have other edges than before; a few that only list them otherwise, too."""
    changed = np.empty(len(earlier), dtype=np.int32)
    count = 0
    for node in range(len(earlier)):
        was = earlier[node]
        first = after.pointer[node]
        same = was >= 0 and before.pointer[was + 1] - before.pointer[was] == after.pointer[node + 1] - first
        if same:
            k = before.pointer[was]
            for e in range(first, after.pointer[node + 1]):
                if earlier[after.neighbour[e]] != before.neighbour[k] or after.length[e] != before.length[k]:
                    same = False
                    break
                k += 1
        if not same:
            changed[count] = node
            count += 1
    return changed[:count]


@njit(cache=True, nogil=True)
def _extend(
    graph: _Graph,
    before: _Known,
    earlier: NDArray[np.int32],
    changed: NDArray[np.int32],
    sources: NDArray[np.int64],
    known: _Known,
    filled: int,
) -> None:
    """Write the rows of some nodes behind those that are filled, from the rows of the graph before where it has them.

    Paths are found by corrected labels in a queue (Moore, 1959): edges are of similar length, so the queue's order is
    nearly that of the distances, and a heap, which makes it exact, takes three times as long. What a length no longer
    follows from is found first, and from there the search goes on (Ramalingam and Reps, 1996).
    """
    count = len(earlier)
    waiting = np.zeros(count, dtype=np.bool_)
    queue = np.empty(count, dtype=np.int32)
    lost = np.empty(count, dtype=np.int32)
    for source in sources:
        row = known.rows[filled]
        known.row_of[source] = filled
        filled += 1
        kept = before.row_of[earlier[source]] if earlier[source] >= 0 else -1
        size = 0
        if kept < 0:
            row[:] = np.inf
            row[source] = 0.0
            queue[0] = source
            size = 1
        else:
            for node in range(count):
                row[node] = before.rows[kept, earlier[node]] if earlier[node] >= 0 else np.inf
            losses = _forget(graph, changed, source, row, waiting, queue, lost)
            for each in range(losses):
                node = lost[each]
                for k in range(graph.pointer[node], graph.pointer[node + 1]):
                    row[node] = min(row[node], row[graph.neighbour[k]] + graph.length[k])
                waiting[node] = True
                queue[size] = node
                size += 1
            for node in changed:
                if not waiting[node] and np.isfinite(row[node]):
                    waiting[node] = True
                    queue[size] = node
                    size += 1
        first = 0
        while size:
            node = queue[first]
            first = first + 1 if first + 1 < count else 0
            size -= 1
            waiting[node] = False
            for k in range(graph.pointer[node], graph.pointer[node + 1]):
                there = graph.neighbour[k]
                through = row[node] + graph.length[k]
                if through < row[there]:
                    row[there] = through
                    if not waiting[there]:
                        waiting[there] = True
                        last = first + size
                        queue[last if last < count else last - count] = there
                        size += 1


@njit(cache=True, nogil=True)
def _forget(
    graph: _Graph,
    changed: NDArray[np.int32],
    source: int,
    row: NDArray[np.float32],
    waiting: NDArray[np.bool_],
    stack: NDArray[np.int32],
    lost: NDArray[np.int32],
) -> int:
    """Make infinite each length that no neighbour's length accounts for any more; return how many are lost."""
    losses = 0
    size = 0
    for node in changed:
        if node != source and np.isfinite(row[node]):
            waiting[node] = True
            stack[size] = node
            size += 1
    while size:
        size -= 1
        node = stack[size]
        waiting[node] = False
        accounted = False
        for k in range(graph.pointer[node], graph.pointer[node + 1]):
            if row[graph.neighbour[k]] + graph.length[k] <= row[node]:
                accounted = True
                break
        if accounted:
            continue
        length = row[node]
        row[node] = np.inf
        lost[losses] = node
        losses += 1
        # An edge is never shorter than a cell, so that no two nodes account for each other.
        for k in range(graph.pointer[node], graph.pointer[node + 1]):
            there = graph.neighbour[k]
            rests = length + graph.length[k] <= row[there] and there != source
            if rests and not waiting[there] and np.isfinite(row[there]):
                waiting[there] = True
                stack[size] = there
                size += 1
    return losses


@njit(cache=True, nogil=True)
def _enter(known: _Known, nodes: NDArray[np.int64], places: NDArray[np.int64], lengths: NDArray[np.float32]) -> None:
    """Write rows and columns of some places into `lengths`."""
    for place in places:
        row = known.rows[known.row_of[nodes[place]]]
        for other in range(len(nodes)):
            lengths[place, other] = row[nodes[other]]
            lengths[other, place] = row[nodes[other]]

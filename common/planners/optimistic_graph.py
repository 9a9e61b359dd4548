"""The viewpoint graph of the world at its best, as far as what the robot has seen and tried does not contradict it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.jit import njit
from common.mapping.adjacency import Adjacency
from common.mapping.mapper import Mapper
from common.mapping.pieces import Cells, piece_at
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, blocker
from common.mapping.squares import Layout
from common.mapping.viewpoints import ViewpointGraph
from common.mapping.ways import length_of
from common.planners.base import Position
from common.planners.graph_search import NO_WAY, GoalGraph, find_place, straight_length
from common.planners.optimistic import MARGIN, OptimisticBelief
from common.planners.visibility import subcells

Place = tuple[int, int]
_NO_NODES: Final = np.empty(0, dtype=np.int32)
_NO_EDGES: Final = Adjacency(np.zeros(1, np.int64), _NO_NODES, np.empty(0), np.empty(0, np.bool_))


@njit(cache=True, nogil=True)
def _flags(x: NDArray[np.int64], y: NDArray[np.int64], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which vertices lie at some of the places, bool."""
    flags = np.zeros(len(x), dtype=np.bool_)
    for k in range(len(places)):
        node = find_place(x, y, places[k, 0], places[k, 1])
        if node >= 0:
            flags[node] = True
    return flags


@njit(cache=True, nogil=True)
def _links(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    numbers: NDArray[np.int32],
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
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
        pieces: of its graph, like the next four.
        first_of: first piece of each square.
        numbers: node of each piece.
        pointer: edges.
        neighbours: likewise.
        possible: vertex of each of its nodes.
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
    is_possible = np.zeros(len(x), dtype=np.bool_)
    for node in range(len(possible)):
        is_possible[possible[node]] = True
    links = np.empty((64, 2), dtype=np.int32)
    count = 0
    for vertex in known:
        if is_possible[vertex] or shut[vertex]:
            continue
        x0, y0 = x[vertex] - corner[0], y[vertex] - corner[1]
        piece = piece_at(pieces, first_of, cells, layout, (y0 >> SUBCELL_BITS) * width + (x0 >> SUBCELL_BITS))
        if piece < 0 or numbers[piece] < 0:
            continue
        node = numbers[piece]
        degree = pointer[node + 1] - pointer[node]
        while count + degree + 1 > len(links):
            more = np.empty((2 * len(links), 2), dtype=np.int32)
            more[:count] = links[:count]
            links = more
        for k in range(-1, degree):
            there = possible[node if k < 0 else neighbours[pointer[node] + k]]
            if shut[there]:
                continue
            x1, y1 = x[there] - corner[0], y[there] - corner[1]
            if k >= 0 and (
                (x1 - x0) ** 2 + (y1 - y0) ** 2 > reach * reach or blocker(cells.clear, width, x0, y0, x1, y1) != CLEAR
            ):
                continue
            links[count, 0], links[count, 1] = vertex, there
            count += 1
    return links[:count].copy()


@njit(cache=True, nogil=True)
def _seen(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    order: NDArray[np.int32],
    pointer: NDArray[np.int64],
    bent: NDArray[np.bool_],
    known: NDArray[np.int8],
    down: int,
    right: int,
) -> NDArray[np.bool_]:
    """Return which nodes with bent edges stand for pieces of which a cell is known to be free.

    Args:
        cells: of the world at its best.
        layout: of its squares.
        pieces: of its graph.
        order: piece of each node.
        pointer: edges, as `Adjacency` has them.
        bent: likewise.
        known: padded grid of the belief.
        down: rows of ``cells`` before those of ``known``.
        right: columns of ``cells`` before those of ``known``.
    """
    seen = np.zeros(len(order), dtype=np.bool_)
    columns = len(layout.x)
    height, width = known.shape
    for node in range(len(order)):
        if not bent[pointer[node] : pointer[node + 1]].any():
            continue
        p = pieces[order[node]]
        j, i = p.square // columns, p.square % columns
        left = max(layout.column_begin[i], right)
        end = min(layout.column_begin[i + 1], right + width)
        for row in range(max(layout.row_begin[j], down), min(layout.row_begin[j + 1], down + height)):
            for column in range(left, end):
                if known[row - down, column - right] == FREE and cells.labels[row * cells.width + column] == p.label:
                    seen[node] = True
                    break
            if seen[node]:
                break
    return seen


@njit(cache=True, nogil=True, inline="always")
def _cost(x: NDArray[np.int64], y: NDArray[np.int64], a: int, b: int, length: float, bent: bool) -> int:
    """Return the cost of an edge: that of the straight line, or that of a way of a length, subcells, if it is bent."""
    straight = straight_length(x[b] - x[a], y[b] - y[a])
    return max(straight, np.int64(np.ceil(length))) if bent else straight


@njit(cache=True, nogil=True)
def _rows(
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    scanned: NDArray[np.bool_],
    closed: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    possible: NDArray[np.int32],
    possible_edges: tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]],
    known: NDArray[np.int32],
    known_edges: tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]],
    links: NDArray[np.int32],
    scale: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int64]]:
    """Collect all edges as `GoalGraph` wants them; lengths are in metres, ``scale`` subcells each.

    Possible edges count between vertices that were not scanned from, bent ones between pieces that were seen; known ones
    always; none at closed vertices.
    """
    n = len(x)
    begin = np.zeros(n + 1, dtype=np.int64)
    ends = np.empty(0, dtype=np.int32)
    costs = np.empty(0, dtype=np.int64)
    for fill in range(2):
        if fill:
            total = np.int64(0)
            for u in range(n + 1):
                degree = begin[u]
                begin[u] = total
                total += degree
            ends = np.empty(total, dtype=np.int32)
            costs = np.empty(total, dtype=np.int64)
        for layer in range(2):
            vertices, (pointer, neighbours, lengths, bent) = possible, possible_edges
            if layer:
                vertices, (pointer, neighbours, lengths, bent) = known, known_edges
            for node in range(len(vertices)):
                u = vertices[node]
                if closed[u] or (scanned[u] and not layer):
                    continue
                for k in range(pointer[node], pointer[node + 1]):
                    v = vertices[neighbours[k]]
                    if closed[v] or (not layer and (scanned[v] or (bent[k] and not (seen[node] and seen[neighbours[k]])))):
                        continue
                    if fill:
                        ends[begin[u]], costs[begin[u]] = v, _cost(x, y, u, v, lengths[k] * scale, bent[k])
                    begin[u] += 1
        for k in range(len(links)):
            for side in range(2):
                u, v = links[k, side], links[k, 1 - side]
                if fill:
                    ends[begin[u]], costs[begin[u]] = v, _cost(x, y, u, v, 0.0, False)
                begin[u] += 1
    # Filling moved each beginning to the next one's place. Walking the vertices in order and noting each with its
    # neighbours sorts every row; of several edges between two vertices the shortest remains.
    pointer = np.zeros(n + 1, dtype=np.int64)
    place = np.zeros(n, dtype=np.int64)
    pointer[1:] = begin[:n]
    place[:] = pointer[:n]
    neighbours = np.empty(len(ends), dtype=np.int32)
    out = np.empty(len(ends), dtype=np.int64)
    for u in range(n):
        for k in range(pointer[u], pointer[u + 1]):
            v = ends[k]
            last = place[v] - 1
            if last >= pointer[v] and neighbours[last] == u:
                out[last] = min(out[last], costs[k])
            else:
                neighbours[place[v]], out[place[v]] = u, costs[k]
                place[v] += 1
    size = 0
    for u in range(n):
        first, last = pointer[u], place[u]
        pointer[u] = size
        for k in range(first, last):
            neighbours[size], out[size] = neighbours[k], out[k]
            size += 1
    pointer[n] = size
    return pointer, neighbours[:size].copy(), out[:size].copy()


@njit(cache=True, nogil=True)
def _straight_legs(
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


class OptimisticGraph:
    """Two viewpoint graphs in one: that of the world at its best, and that of what is known.

    Where viewpoints of both lie at the same place, they are one vertex; a known viewpoint elsewhere is joined with the
    possible viewpoint of the piece that it lies in, and with those around that are in line. The edges of a vertex that
    the robot has scanned from are the known ones alone: another scan from the same place would tell nothing new about
    the others. So every edge that leads on from where the robot has scanned can be driven.

    A bent way through what is not known is believed only between pieces of which something was seen. Between any others
    there is one wherever a scan left a cell of a wall out, and hoping for doors in each of them leads astray.

    Attributes:
        world: the cells underneath.
        viewpoints: the viewpoint graph of the world at its best; its lattice is the mapper's.
        graph: of the last update, in subcells from the belief's anchor.
    """

    graph: GoalGraph
    viewpoints: ViewpointGraph

    def __init__(self, config: MappingConfig, target: Position) -> None:
        """Cover nothing yet; the target is in metres."""
        self._config = config
        self._target = target
        self.world = OptimisticBelief(MARGIN * config.viewpoint_spacing)
        self._generation = -1
        self._scanned: set[Place] = set()
        self._closed: set[Place] = set()
        self._closed_legs: set[Place] = set()

    def update(self, mapper: Mapper, *, scanned: bool) -> int:
        """Bring all up to date.

        Args:
            mapper: updated, and not stuck.
            scanned: the robot has scanned from its viewpoint.

        Returns:
            The vertex of the robot's viewpoint.
        """
        viewpoint = mapper.position(mapper.robot)
        self.bring_up_to_date(mapper, viewpoint)
        view, belief, world = self.viewpoints, mapper.belief, self.world
        if view.robot < 0:
            order, numbers, edges = _NO_NODES, np.full(view.used, -1, dtype=np.int32), _NO_EDGES
        else:
            order, numbers, edges = view.reachable()
        possible, known = view.pieces[order], _places(mapper)
        corner = _corner(world.first_cell)
        places = np.concatenate([np.stack([possible["x"], possible["y"]], axis=1) + corner, known])
        x, y, vertices = _merge(places)
        possible_vertices, self._known = vertices[: len(order)], vertices[len(order) :]
        start = int(self._known[mapper.robot])
        if scanned:
            self._scanned.add((int(x[start]), int(y[start])))
        done, closed = (_flags(x, y, _array(places)) for places in (self._scanned, self._closed))
        links = _links(
            view.cells, view.layout, view.pieces, view.first_of, numbers, edges.pointer, edges.neighbours,
            possible_vertices, self._known, x, y, corner, done | closed, view.edge_reach,
        )  # fmt: skip
        down, right = (a - b for a, b in zip(belief.first_cell, world.first_cell, strict=True))
        seen = _seen(
            view.cells, view.layout, view.pieces, order, edges.pointer, edges.bent, belief.padded, down, right
        )
        pointer, neighbours, costs = _rows(
            x, y, done, closed, seen, possible_vertices, _columns(edges), self._known, _columns(mapper.adjacency), links,
            SUBCELLS / belief.resolution,
        )  # fmt: skip
        legs, straight = self._legs(mapper, x, y, done | closed, possible_vertices, numbers)
        legs[closed | _flags(x, y, _array(self._closed_legs))] = NO_WAY
        self.graph = GoalGraph(x, y, pointer, neighbours, costs, legs, straight)
        return start

    def bring_up_to_date(self, mapper: Mapper, viewpoint: Position) -> None:
        """Bring the world and its viewpoint graph up to date, for a robot at some viewpoint, metres."""
        world = self.world
        world.update(mapper.belief, viewpoint, self._target)
        if world.generation != self._generation:
            self._generation = world.generation
            config = self._config
            self.viewpoints = ViewpointGraph(
                world, mapper.lattice_origin, config.viewpoint_spacing, config.robot_radius
            )
            self.viewpoints.dirty[:] = True
        view = self.viewpoints
        rows, columns = np.divmod(world.changed, view.cells.width)
        view.dirty[view.layout.row_of[rows], view.layout.column_of[columns]] = True
        view.update(world.box, world.lost, world.subcells(viewpoint))

    def position(self, vertex: int) -> Position:
        """Return where a vertex of the last update is, metres."""
        world = self.world
        right, up = _corner(world.first_cell)
        (x, y), step = world.origin, world.resolution
        return (
            x + ((self.graph.x[vertex] - right) / SUBCELLS - 1.0) * step,
            y + ((self.graph.y[vertex] - up) / SUBCELLS - 1.0) * step,
        )

    def known_node(self, vertex: int) -> int:
        """Return the mapper's node at a vertex of the last update, -1 when it has none there."""
        nodes = np.flatnonzero(self._known == vertex)
        return int(nodes[0]) if len(nodes) else -1

    def close(self, vertex: int) -> None:
        """Give up a viewpoint that the robot does not get to, from the next update on."""
        self._closed.add((int(self.graph.x[vertex]), int(self.graph.y[vertex])))

    def close_leg(self, vertex: int) -> None:
        """Give up the last leg from a viewpoint to the target, from the next update on."""
        self._closed_legs.add((int(self.graph.x[vertex]), int(self.graph.y[vertex])))

    def _legs(
        self,
        mapper: Mapper,
        x: NDArray[np.int64],
        y: NDArray[np.int64],
        shut: NDArray[np.bool_],
        possible: NDArray[np.int32],
        numbers: NDArray[np.int32],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the last legs to the target, and the straight distances."""
        view, world = self.viewpoints, self.world
        right, up = corner = _corner(world.first_cell)
        here = world.subcells(self._target)
        target = (here[0] + right, here[1] + up)
        cells = view.cells
        straight, legs = _straight_legs(cells.clear, cells.width, x, y, corner, shut, target, view.edge_reach)
        if world.padded[here[1] >> SUBCELL_BITS, here[0] >> SUBCELL_BITS] == OCCUPIED:
            return legs, straight
        if (legs >= NO_WAY).all():
            # As for the mapper: where no viewpoint has the target in line, that of its piece leads to it.
            piece = view.piece_of(here)
            if piece >= 0 and numbers[piece] >= 0 and not shut[possible[numbers[piece]]]:
                p = view.pieces[piece]
                way = view.way_within(piece, (int(p["x"]), int(p["y"])), here)
                vertex = possible[numbers[piece]]
                legs[vertex] = max(int(np.ceil(length_of(way))), straight[vertex])
        if mapper.target_known:
            node = len(self._known)
            scale = SUBCELLS / world.resolution
            for link in mapper.observe().target_links.tolist():
                corners = np.array([mapper.position(link), *mapper.way(link, node)])
                length = np.hypot(*np.diff(corners, axis=0).T).sum() * scale
                vertex = self._known[link]
                legs[vertex] = min(legs[vertex], max(int(np.ceil(length)), straight[vertex]))
        return legs, straight


def _corner(first_cell: tuple[int, int]) -> Place:
    """Return (x, y) of the lower left corner of a padded grid, subcells from the anchor."""
    return (first_cell[1] - 1) << SUBCELL_BITS, (first_cell[0] - 1) << SUBCELL_BITS


def _places(mapper: Mapper) -> NDArray[np.int64]:
    """Return where the mapper's viewpoints are, subcells from the anchor, shape (n, 2)."""
    belief = mapper.belief
    return subcells(belief, mapper.viewpoints) + np.array(_corner(belief.first_cell))


def _merge(places: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
    """Return x and y of all different places, ascending by y, then by x, and the number of each given one."""
    order = np.lexsort((places[:, 0], places[:, 1]))
    ordered = places[order]
    new = np.ones(len(order), dtype=np.bool_)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.empty(len(order), dtype=np.int32)
    numbers[order] = np.cumsum(new) - 1
    return np.ascontiguousarray(ordered[new, 0]), np.ascontiguousarray(ordered[new, 1]), numbers


def _array(places: set[Place]) -> NDArray[np.int64]:
    return np.array(list(places), dtype=np.int64).reshape(-1, 2)


def _columns(
    edges: Adjacency,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]]:
    return edges.pointer, edges.neighbours, edges.lengths, edges.bent

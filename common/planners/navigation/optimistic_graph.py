"""The viewpoint graph of the optimistic world, minus what the robot has seen and tried to be otherwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.mapping.mapper import Mapper
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import OCCUPIED
from common.mapping.squares import mark_all
from common.mapping.viewpoints import ViewpointGraph
from common.mapping.ways import length_of
from common.planners.base import Position
from common.planners.navigation.graph_search import NO_WAY, GoalGraph
from common.planners.navigation.joint_graph import (
    Place,
    edge_rows,
    flags_at,
    links_between,
    merge_places,
    seen_pieces,
    straight_legs,
)
from common.planners.navigation.optimistic import MARGIN, OptimisticBelief
from common.planners.visibility import subcells


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
        corner = _corner(world.first_cell)
        exist = np.flatnonzero(view.pieces["exists"])
        known = _places(mapper)
        x, y, vertices = merge_places(
            np.concatenate([view.pieces["x"][exist] + corner[0], known[:, 0]]),
            np.concatenate([view.pieces["y"][exist] + corner[1], known[:, 1]]),
        )
        possible = np.full(view.used, -1, dtype=np.int32)
        possible[exist], self._known = vertices[: len(exist)], vertices[len(exist) :]
        start = int(self._known[mapper.robot])
        if scanned:
            self._scanned.add((int(x[start]), int(y[start])))
        done, closed = flags_at(x, y, _array(self._scanned)), flags_at(x, y, _array(self._closed))
        links = links_between(
            view.cells, view.layout, view.pieces, view.first_of, possible, self._known, x, y, corner, done | closed,
            view.edge_reach,
        )  # fmt: skip
        down, right = (a - b for a, b in zip(belief.first_cell, world.first_cell, strict=True))
        pairs, touches = view.edge_lists
        seen = seen_pieces(view.cells, view.layout, view.pieces, touches, belief.padded, down, right)
        edges = mapper.adjacency
        pointer, neighbours, costs = edge_rows(
            x, y, done, closed, seen, possible, pairs, touches, self._known,
            (edges.pointer, edges.neighbours, edges.lengths, edges.bent), links, SUBCELLS / belief.resolution,
        )  # fmt: skip
        legs, straight = self._legs(mapper, x, y, done | closed, possible)
        legs[closed | flags_at(x, y, _array(self._closed_legs))] = NO_WAY
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
        mark_all(view.layout, world.changed, view.dirty, view.beside)
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
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the last legs to the target, and the straight distances."""
        view, world = self.viewpoints, self.world
        right, up = corner = _corner(world.first_cell)
        here = world.subcells(self._target)
        target = (here[0] + right, here[1] + up)
        cells = view.cells
        straight, legs = straight_legs(cells.clear, cells.width, x, y, corner, shut, target, view.edge_reach)
        if world.padded[here[1] >> SUBCELL_BITS, here[0] >> SUBCELL_BITS] == OCCUPIED:
            return legs, straight
        if (legs >= NO_WAY).all():
            # As for the mapper: where no viewpoint has the target in line, that of its piece leads to it.
            piece = view.piece_of(here)
            vertex = possible[piece] if piece >= 0 else -1
            if vertex >= 0 and not shut[vertex]:
                p = view.pieces[piece]
                way = view.way_within(piece, (int(p["x"]), int(p["y"])), here)
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


def _array(places: set[Place]) -> NDArray[np.int64]:
    return np.array(list(places), dtype=np.int64).reshape(-1, 2)

"""The viewpoint graph of a mapper as planners read it: numbered viewpoints, edges, and the ways between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import MappingError
from common.mapping.adjacency import Adjacency
from common.mapping.belief import Belief
from common.mapping.distances import shortest_paths
from common.mapping.pieces import cells_of_nodes
from common.mapping.raycast import SUBCELLS
from common.mapping.target import Target
from common.mapping.viewpoints import ViewpointGraph
from common.observations.observation import Observation


class GraphView:
    """The graph of the last update of a `Mapper`, which is the one that makes it; nothing here changes it.

    Attributes:
        belief: the grid.
    """

    belief: Belief
    _config: MappingConfig
    _lattice_origin: tuple[float, float]
    _origin: NDArray[np.float64]
    _robot: int
    _order: NDArray[np.int32]
    _numbers: NDArray[np.int32]
    _edges: Adjacency
    _positions: NDArray[np.float64]
    _target: Target | None
    _observation: Observation
    _graph: ViewpointGraph

    @property
    def target(self) -> tuple[float, float] | None:
        """(x, y) of the navigation target, metres, or None."""
        return None if self._target is None else self._target.position

    @property
    def stuck(self) -> bool:
        """Whether the last update found no clear space where the robot is, so that there is no observation."""
        return self._robot < 0

    @property
    def robot(self) -> int:
        """Node number of the robot's viewpoint; -1 when stuck."""
        return self._robot

    @property
    def target_known(self) -> bool:
        """Whether the target is known to be free and tied to viewpoints in sight; see `Observation`."""
        return self._target is not None and self._target.known

    @property
    def lattice_origin(self) -> tuple[float, float]:
        """(x, y) of one point of the viewpoint lattice, metres."""
        return self._lattice_origin

    @property
    def viewpoints(self) -> NDArray[np.float64]:
        """Positions of the observation's viewpoints by node number, metres, shape (n, 2); a copy."""
        return self._positions.copy()

    @property
    def edges(self) -> NDArray[np.int64]:
        """Edges of the observation as pairs of node numbers, the lower first, shape (m, 2)."""
        lower = np.repeat(np.arange(len(self._order)), np.diff(self._edges.pointer))
        pairs = np.stack([lower, self._edges.neighbours], axis=1).astype(np.int64)
        return pairs[pairs[:, 0] < pairs[:, 1]]

    @property
    def adjacency(self) -> Adjacency:
        """The edges of the observation's viewpoints as rows of neighbours, with their lengths in metres."""
        return self._edges

    @property
    def beacons(self) -> NDArray[np.float64]:
        """Positions of the beacons in node order, a known target last, metres, shape (m, 2)."""
        positions = self._positions[self._observation.beacon] if not self.stuck else np.empty((0, 2))
        return np.concatenate([positions, [self.target]]) if self.target_known else positions

    def position(self, node: int) -> tuple[float, float]:
        """Return the position of a node of the last update, metres; number n is the target.

        Raises:
            MappingError: there is no such node.
        """
        n = len(self._order)
        if node == n and self.target is not None and not self.stuck:
            return self.target
        self._check_node(node, n)
        x, y = self._positions[node]
        return float(x), float(y)

    def nodes_at(self, positions: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the viewpoint that stands for each of some positions: that of the piece of clear space which holds it.

        Args:
            positions: metres, shape (m, 2).

        Returns:
            Node numbers, -1 where a position lies in no piece of the last update's graph, int64, shape (m,).
        """
        pieces = self._graph.pieces_at(*self._subcells(positions))
        return np.where(pieces >= 0, self._numbers[pieces], -1).astype(np.int64)

    def reachable_cells(self) -> NDArray[np.bool_]:
        """Return the cells in whose middle the robot can get from where it is: those that the viewpoints stand for.

        Returns:
            bool, shape of the belief's padded grid.
        """
        graph = self._graph
        inside = cells_of_nodes(graph.pieces, graph.first_of, graph.cells, graph.layout, self._numbers)
        return inside.reshape(self.belief.padded.shape)

    def joined(self, a: int, b: int) -> bool:
        """Whether an edge joins two nodes, so that there is a `way`; no number of a node is joined with nothing."""
        n = len(self._order)
        if b == n and self._target is not None:
            return self._target.known and a in self._target.links
        return 0 <= a < n and 0 <= b < n and b in self._edges.of(a)

    def way(self, a: int, b: int) -> list[tuple[float, float]]:
        """Return where to drive from a node to a neighbour: the corners of the edge and the neighbour, metres.

        Raises:
            MappingError: a node does not exist, or no edge joins the two.
        """
        n = len(self._order)
        self._check_node(a, n)
        goal = self.position(b)
        if b == n:
            assert self._target is not None
            if a not in self._target.links:
                raise MappingError(
                    f"node {a} has no link to the target: ask for the ways between neighbours, as `path` does"
                )
            return [*self._metres(self._target.way(self._graph, int(self._order[a]))[1:-1]), goal]
        row = slice(int(self._edges.pointer[a]), int(self._edges.pointer[a + 1]))
        place = np.flatnonzero(self._edges.neighbours[row] == b)
        if not len(place):
            raise MappingError(f"no edge joins nodes {a} and {b}: ask for the ways between neighbours, as `path` does")
        if not self._edges.bent[row][place[0]]:
            return [goal]
        corners = self._graph.way(int(self._order[a]), int(self._order[b]))
        return [*self._metres(corners[1:-1]), goal]

    def way_inside(self, node: int, start: tuple[float, float], goal: tuple[float, float]) -> list[tuple[float, float]]:
        """Return the way between two places of a node's piece of clear space: the corners and the goal, metres."""
        subcells = self.belief.subcells
        corners = self._graph.way_within(int(self._order[node]), subcells(start), subcells(goal))
        return [*self._metres(corners[1:-1]), goal]

    def distances(self, from_node: int) -> NDArray[np.float64]:
        """Return the distance of every node from a viewpoint over edges, metres, shape (nodes,).

        The target's, if there is one, is that over its best link; no path leads through the target.

        Raises:
            MappingError: `from_node` is not a viewpoint of the last update.
        """
        return self.shortest_paths(from_node)[0]

    def path(self, from_node: int, to_node: int) -> list[int]:
        """Return the nodes of a shortest path, both ends included; empty when none leads there.

        Raises:
            MappingError: `from_node` is not a viewpoint, or `to_node` not a node, of the last update.
        """
        self._check_node(to_node, len(self._order) + (self._target is not None))
        distances, before = self._search(from_node, to_node)
        if not np.isfinite(distances[to_node]):
            return []
        nodes = [to_node]
        while nodes[-1] != from_node:
            nodes.append(int(before[nodes[-1]]))
        return nodes[::-1]

    def shortest_paths(self, from_node: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return `distances` and the node before each one on its shortest path, -1 without one, int32, shape (nodes,).

        Raises:
            MappingError: `from_node` is not a viewpoint of the last update.
        """
        return self._search(from_node, -1)

    def _search(self, from_node: int, goal: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return the same; with a viewpoint for a goal only what is nearer than that is sure."""
        self._check_node(from_node, len(self._order))
        edges = self._edges
        # The target is no viewpoint, so all its links are needed.
        distances, before = shortest_paths(edges.pointer, edges.neighbours, edges.lengths, from_node, goal)
        if self._target is None:
            return distances, before
        ways = distances[self._target.links] + self._target.lengths
        best = int(np.argmin(ways)) if len(ways) else -1
        length, link = (ways[best], self._target.links[best]) if best >= 0 and np.isfinite(ways[best]) else (np.inf, -1)
        return np.append(distances, length), np.append(before, np.int32(link))

    def _check_node(self, node: int, count: int) -> None:
        if not 0 <= node < count:
            raise MappingError(
                f"there is no node {node}, the last update has {count}: use node numbers of the last observation"
            )

    def _subcells(self, positions: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return x and y of positions, metres, shape (m, 2), in subcells, int64, shape (2, m)."""
        cells = (positions - self._origin) / self.belief.resolution + 1.0
        return np.rint(cells.T * SUBCELLS).astype(np.int64)

    def _metres(self, points: NDArray[np.int64]) -> list[tuple[float, float]]:
        places = (points / SUBCELLS - 1.0) * self.belief.resolution + self._origin
        return [(float(x), float(y)) for x, y in places]

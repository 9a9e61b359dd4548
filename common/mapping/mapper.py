"""The mapper: scans and poses in, the observation of the paper's planning problem out."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.errors import MappingError
from common.geometry import Pose, Scan
from common.jit import njit
from common.mapping.beacons import find_beacons, nearest_in_sight
from common.mapping.belief import Belief
from common.mapping.distances import OFFSET_LENGTHS, shortest_paths
from common.mapping.frontiers import Frontiers
from common.mapping.raycast import SUBCELL_BITS, SUBCELLS
from common.mapping.sight import CLEAR, FREE, blocker
from common.mapping.utility import FrontierUtility
from common.mapping.viewpoints import NODE_REACH, ViewpointGraph
from common.observation import (
    MAX_TARGET_LINKS,
    MAX_VIEWPOINTS,
    NEIGHBOUR_COUNT,
    NEIGHBOUR_OFFSETS,
    Observation,
)

# A known target is tied to viewpoints as far as edges reach: the longest of the 20 neighbour offsets is (2, 1).
TARGET_REACH: Final = 5.0**0.5
_NO_NODES: Final = np.empty(0, dtype=np.int32)


@njit(cache=True, nogil=True)
def _gather(
    order: NDArray[np.int32],
    columns: int,
    lattice_x: NDArray[np.int64],
    lattice_y: NDArray[np.int64],
    edges: NDArray[np.uint32],
    counts: NDArray[np.int32],
    visited: NDArray[np.bool_],
    min_utility: int,
    least_utility: int,
    start: int,
) -> tuple[
    NDArray[np.int64],
    NDArray[np.int64],
    NDArray[np.int16],
    NDArray[np.uint16],
    NDArray[np.bool_],
    NDArray[np.uint32],
]:
    """Collect positions in subcells, offsets from `start`, utility, visited flags and edges of the nodes in order."""
    n = len(order)
    most = 0
    for node in range(n):
        most = max(most, counts[order[node] // columns, order[node] % columns])
    threshold = min_utility if most >= min_utility else min(least_utility, min_utility)
    x = np.empty(n, dtype=np.int64)
    y = np.empty(n, dtype=np.int64)
    offsets = np.empty((n, 2), dtype=np.int16)
    utility = np.empty(n, dtype=np.uint16)
    been = np.empty(n, dtype=np.bool_)
    masks = np.empty(n, dtype=np.uint32)
    for node in range(n):
        j, i = order[node] // columns, order[node] % columns
        x[node] = lattice_x[i]
        y[node] = lattice_y[j]
        offsets[node, 0] = i - start % columns
        offsets[node, 1] = j - start // columns
        count = counts[j, i]
        utility[node] = min(count, 65535) if count >= threshold else 0
        been[node] = visited[j, i]
        masks[node] = edges[j, i]
    return x, y, offsets, utility, been, masks


class Mapper:
    """What one robot knows, and the graph that it plans on; the same in simulation and on the robot.

    Usage::

        mapper = Mapper(config.mapping, lattice_origin=world.lattice_origin)
        mapper.integrate(scan, pose)  # any number of times
        mapper.update(pose)
        observation = mapper.observe()
        waypoint = mapper.position(node)

    `update` recomputes only what the changes of the belief since the last update can have touched; the result is
    the same as if everything were computed from the belief alone. Node numbers are those of the last update.

    Attributes:
        belief: the grid; it grows by itself when a scan reaches outside.
        target: (x, y) of the navigation target, metres, or None.
        frontiers_removed: frontier cells that updates have found to be frontiers no more, since the start; it only
            rises, so that differences tell what a step achieved.
    """

    def __init__(
        self,
        config: MappingConfig,
        *,
        lattice_origin: tuple[float, float],
        bounds: tuple[float, float, float, float] | None = None,
        target: tuple[float, float] | None = None,
    ) -> None:
        """Start with an unknown belief.

        Args:
            config: resolution, ranges and spacing.
            lattice_origin: (x, y) of one point of the viewpoint lattice, metres.
            bounds: x_min, y_min, x_max, y_max that are allocated at first, metres; nothing when not given.
            target: (x, y) of the navigation target, metres.

        Raises:
            MappingError: a position is not finite, or the bounds are empty.
        """
        for name, point in (("lattice_origin", lattice_origin), ("target", target)):
            if point is not None and not np.isfinite(point).all():
                raise MappingError(f"{name} must be finite, got {point}: pass (x, y) in metres")
        self.belief = Belief(config.resolution, config.sensor_range, anchor=lattice_origin, bounds=bounds)
        self.target = target
        self.frontiers_removed = 0
        self._config = config
        self._lattice_origin = lattice_origin
        self._spacing_subcells = round(config.viewpoint_spacing / config.resolution * SUBCELLS)
        self._beacon_reach = round(config.beacon_range / config.resolution * SUBCELLS)
        # One subcell of rounding must not cut off a viewpoint that is exactly as far as edges reach.
        self._target_reach = int(TARGET_REACH * config.viewpoint_spacing / config.resolution * SUBCELLS) + 2
        self._pose: Pose | None = None
        self._node = -1
        self._rebuild(None)
        self._forget_nodes()

    def integrate(self, scan: Scan, pose: Pose) -> int:
        """Add a scan to the belief and return the number of cells that became known; see `Belief.integrate`."""
        return self.belief.integrate(scan, pose)

    def update(self, pose: Pose) -> None:
        """Bring frontiers, viewpoints, edges, utilities, beacons, visited flags and the robot's node up to date.

        A viewpoint counts as visited when it is the robot's node and within half a spacing.

        Raises:
            MappingError: the pose is not finite, or more viewpoints are reachable than an observation can hold.
        """
        if not (isfinite(pose.x) and isfinite(pose.y)):
            raise MappingError(f"a pose must be finite, got {pose}: check the robot's localisation")
        belief = self.belief
        if belief.generation != self._generation:
            self._rebuild(self._graph)
        padded = belief.padded
        cells, width = padded.reshape(-1), padded.shape[1]
        changed = belief.take_changes()
        if changed is not None:
            frontier_changes = self._frontiers.update(padded, changed)
            self.frontiers_removed += len(frontier_changes.removed)
            self._graph.update(cells, width, changed, frontier_changes.lost)
            self._utility.update(cells, width, changed, frontier_changes)
        self._pose = pose
        self._find_node(pose, cells, width)
        if self._node >= 0:
            self._plan(cells, width)
        else:
            self._forget_nodes()

    def observe(self) -> Observation:
        """Return the observation of the last update.

        Raises:
            MappingError: there was no update yet, or no viewpoint can be reached from the pose (see `stuck`).
        """
        if self._pose is None:
            raise MappingError("nothing to observe yet: call update(pose) after integrating a scan")
        if self._node < 0:
            raise MappingError(
                f"no viewpoint within {NODE_REACH * self._config.viewpoint_spacing:g} m of ({self._pose.x:.2f}, "
                f"{self._pose.y:.2f}) can be reached in a straight free line: integrate more scans, move the robot "
                "into free space, or use a smaller mapping.viewpoint_spacing"
            )
        return Observation(
            offsets=self._offsets,
            utility=self._useful,
            visited=self._visited,
            beacon=self._beacon,
            edges=self._edges,
            robot=self._robot,
            has_target=self.target is not None,
            target_known=self._target_known,
            target_offset=self._target_offset,
            target_links=self._target_links,
        )

    @property
    def stuck(self) -> bool:
        """Whether the last update found no viewpoint within reach of the robot, so that there is no observation."""
        return self._node < 0

    @property
    def explored_area(self) -> float:
        """Area known to be free, square metres."""
        return self.belief.free_area

    @property
    def robot(self) -> int:
        """Node number of the robot's viewpoint; -1 when stuck."""
        return self._robot

    @property
    def target_known(self) -> bool:
        """Whether the target is known to be free and tied to viewpoints in sight; see `Observation`."""
        return self._target_known

    @property
    def frontiers(self) -> NDArray[np.float64]:
        """Centres of all frontier cells, row-major, metres, shape (m, 2)."""
        rows, columns = np.nonzero(self._frontiers.mask)
        return np.stack([columns + 0.5, rows + 0.5], axis=1) * self.belief.resolution + self._origin

    def sightings(self) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return which frontier cells each viewpoint of the last update observes: in range and in line of sight.

        Returns:
            Sparse rows by node number: the first entry of each, int64, shape (n + 1,), and the entries, places in
            `frontiers`, ascending within a row, int32.
        """
        if self._node < 0:
            return np.zeros(1, dtype=np.int64), _NO_NODES
        rows, columns = np.nonzero(self._frontiers.mask)
        width = self.belief.padded.shape[1]
        return self._utility.sightings((rows + 1) * width + columns + 1, self._numbers, len(self._order))

    @property
    def viewpoints(self) -> NDArray[np.float64]:
        """Positions of the observation's viewpoints by node number, metres, shape (n, 2)."""
        first = np.array(self._graph.first)
        columns = max(self._graph.exists.shape[1], 1)
        steps = np.stack([self._order % columns, self._order // columns], axis=1) + first
        return np.array(self._lattice_origin) + steps * self._config.viewpoint_spacing

    @property
    def edges(self) -> NDArray[np.int64]:
        """Edges of the observation as pairs of node numbers, the lower first, shape (m, 2)."""
        if self._node < 0:
            return np.empty((0, 2), dtype=np.int64)
        columns = self._graph.exists.shape[1]
        pairs = []
        for k in range(NEIGHBOUR_COUNT // 2, NEIGHBOUR_COUNT):
            dx, dy = int(NEIGHBOUR_OFFSETS[k, 0]), int(NEIGHBOUR_OFFSETS[k, 1])
            nodes = np.flatnonzero(self._edges >> np.uint32(k) & np.uint32(1))
            pairs.append(np.stack([nodes, self._numbers[self._order[nodes] + dy * columns + dx]], axis=1))
        return np.concatenate(pairs).astype(np.int64)

    @property
    def edge_lengths(self) -> NDArray[np.float64]:
        """Length of each of the `edges`, metres, shape (m,)."""
        ends = self.viewpoints[self.edges]
        return np.asarray(np.hypot(*(ends[:, 1] - ends[:, 0]).T), dtype=np.float64)

    @property
    def beacons(self) -> NDArray[np.float64]:
        """Positions of the beacons in node order, a known target last, metres, shape (m, 2)."""
        positions = self.viewpoints[self._beacon]
        return np.concatenate([positions, [self.target]]) if self._target_known else positions

    def position(self, node: int) -> tuple[float, float]:
        """Return the position of a node of the last update, metres; number n is the target.

        Raises:
            MappingError: there is no such node.
        """
        n = len(self._order)
        if node == n and self.target is not None and self._node >= 0:
            return self.target
        self._check_node(node, n)
        columns = self._graph.exists.shape[1]
        index = int(self._order[node])
        return (
            self._lattice_origin[0] + (index % columns + self._graph.first[0]) * self._config.viewpoint_spacing,
            self._lattice_origin[1] + (index // columns + self._graph.first[1]) * self._config.viewpoint_spacing,
        )

    def segment_free(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether all cells that the straight segment between two positions touches are known to be free."""
        rows, columns = self.belief.shape
        points = (*self.belief.subcells(a), *self.belief.subcells(b))
        for x, y in (points[:2], points[2:]):
            if not (1 <= x >> SUBCELL_BITS <= columns and 1 <= y >> SUBCELL_BITS <= rows):
                return False
        padded = self.belief.padded
        return bool(blocker(padded.reshape(-1), padded.shape[1], *points) == CLEAR)

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
        distances, before = self.shortest_paths(from_node)
        self._check_node(to_node, len(distances))
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
        self._check_node(from_node, len(self._order))
        spacing = self._config.viewpoint_spacing
        distances, before = shortest_paths(
            self._graph.edges, NEIGHBOUR_OFFSETS, OFFSET_LENGTHS, self._order, self._numbers, from_node, spacing
        )
        if self.target is None:
            return distances, before
        best, link = np.inf, -1
        for node in self._target_links:
            x, y = self.position(int(node))
            length = distances[node] + float(np.hypot(self.target[0] - x, self.target[1] - y))
            if length < best:
                best, link = length, int(node)
        return np.append(distances, best), np.append(before, np.int32(link))

    def _check_node(self, node: int, count: int) -> None:
        if not 0 <= node < count:
            raise MappingError(
                f"there is no node {node}, the last update has {count}: use node numbers of the last observation"
            )

    def _rebuild(self, previous: ViewpointGraph | None) -> None:
        """Start anew on a belief that was allocated anew: all of it counts as changed."""
        spacing = self._config.viewpoint_spacing
        self._generation = self.belief.generation
        self._origin = np.array(self.belief.origin)
        self._frontiers = Frontiers(self.belief)
        self._graph = ViewpointGraph(self.belief, self._lattice_origin, spacing, previous)
        self._utility = FrontierUtility(self.belief, self._graph, self._config.observable_range, spacing)

    def _find_node(self, pose: Pose, cells: NDArray[np.int8], width: int) -> None:
        x, y = self.belief.subcells(pose.position)
        rows, columns = self.belief.shape
        inside = 1 <= x >> SUBCELL_BITS <= columns and 1 <= y >> SUBCELL_BITS <= rows
        self._node = self._graph.robot_node(cells, width, x, y) if inside else -1
        if self._node >= 0:
            j, i = divmod(self._node, self._graph.exists.shape[1])
            dx, dy = int(self._graph.x[i]) - x, int(self._graph.y[j]) - y
            if 4 * (dx * dx + dy * dy) <= self._spacing_subcells**2:
                self._graph.visited[j, i] = True

    def _plan(self, cells: NDArray[np.int8], width: int) -> None:
        """Number the nodes, collect the planning set and choose the beacons."""
        graph, config = self._graph, self._config
        self._order, self._numbers = graph.number_reachable(self._node)
        if len(self._order) > MAX_VIEWPOINTS:
            raise MappingError(
                f"{len(self._order)} viewpoints are reachable, an observation holds {MAX_VIEWPOINTS}: "
                "raise mapping.viewpoint_spacing"
            )
        self._robot = int(self._numbers[self._node])
        x, y, self._offsets, self._useful, self._visited, self._edges = _gather(
            self._order,
            graph.exists.shape[1],
            graph.x,
            graph.y,
            graph.edges,
            self._utility.counts,
            graph.visited,
            config.min_utility,
            config.least_utility,
            self._node,
        )
        self._beacon = find_beacons(cells, width, x, y, self._useful > 0, self._beacon_reach)
        if self.target is not None:
            self._tie_target(self.target, cells, width, x, y)

    def _tie_target(
        self,
        target: tuple[float, float],
        cells: NDArray[np.int8],
        width: int,
        x: NDArray[np.int64],
        y: NDArray[np.int64],
    ) -> None:
        """Link the target with the viewpoints in sight, or with the nearest beacons while there are none."""
        robot_x, robot_y = self.position(self._robot)
        spacing = self._config.viewpoint_spacing
        self._target_offset = np.array(
            [(target[0] - robot_x) / spacing, (target[1] - robot_y) / spacing], dtype=np.float32
        )
        target_x, target_y = self.belief.subcells(target)
        links = np.empty(0, dtype=np.int64)
        if self.belief.at(target) == FREE:
            links = nearest_in_sight(cells, width, x, y, target_x, target_y, self._target_reach, MAX_TARGET_LINKS)
        self._target_known = len(links) > 0
        if not self._target_known:
            beacons = np.flatnonzero(self._beacon)
            far = (x[beacons] - target_x) ** 2 + (y[beacons] - target_y) ** 2
            links = np.sort(beacons[np.argsort(far, kind="stable")[:MAX_TARGET_LINKS]])
        self._target_links = links.astype(np.uint16)

    def _forget_nodes(self) -> None:
        self._robot = -1
        self._order = _NO_NODES
        self._numbers = _NO_NODES
        self._offsets = np.empty((0, 2), dtype=np.int16)
        self._useful = np.empty(0, dtype=np.uint16)
        self._visited = np.empty(0, dtype=np.bool_)
        self._beacon = np.empty(0, dtype=np.bool_)
        self._edges = np.empty(0, dtype=np.uint32)
        self._target_known = False
        self._target_offset = np.zeros(2, dtype=np.float32)
        self._target_links = np.empty(0, dtype=np.uint16)

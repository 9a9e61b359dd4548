"""The viewpoint graph of the true map, as a robot that knows all of it would have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.maps.clear_space import known_cells
from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.errors import MapError
from common.geometry import Pose
from common.mapping.distances import shortest_paths
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED
from common.system.copies import copy_values
from common.system.jit import njit

# Rounding must not keep an edge that a viewpoint lies on, metres.
TOLERANCE = 1e-6


@njit(cache=True, nogil=True)
def _needed(
    pointer: NDArray[np.int64], neighbours: NDArray[np.int32], lengths: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which edges are shorter than every way over one viewpoint between, bool, shape of ``neighbours``."""
    n = len(pointer) - 1
    needed = np.ones(len(neighbours), dtype=np.bool_)
    length_to = np.full(n, np.inf)
    for a in range(n):
        for k in range(pointer[a], pointer[a + 1]):
            length_to[neighbours[k]] = lengths[k]
        for k in range(pointer[a], pointer[a + 1]):
            b = neighbours[k]
            for m in range(pointer[b], pointer[b + 1]):
                if length_to[neighbours[m]] + lengths[m] <= lengths[k] + TOLERANCE:
                    needed[k] = False
                    break
        for k in range(pointer[a], pointer[a + 1]):
            length_to[neighbours[k]] = np.inf
    return needed


@njit(cache=True, nogil=True)
def _all_distances(
    pointer: NDArray[np.int64], neighbours: NDArray[np.int32], lengths: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the distances between all nodes, metres, shape (n, n)."""
    n = len(pointer) - 1
    distances = np.empty((n, n), dtype=np.float32)
    for node in range(n):
        copy_values(distances[node], shortest_paths(pointer, neighbours, lengths, node, -1)[0])
    return distances


@dataclass(frozen=True, slots=True, eq=False)
class TrueGraph:
    """All viewpoints of a true map that connect with the start, and their edges.

    The robot's own mapping makes it, from a belief in which everything is known. An edge that is no shorter than the
    way over a viewpoint between is left out: it leads nowhere sooner, and a robot that stops between sees more.

    Attributes:
        mapper: knows the whole world and stands at its start; answers for positions, ways and free segments.
        positions: of the viewpoints, metres, float64, shape (n, 2).
        points: likewise in cells of the map from its lower left corner.
        pointer: first edge of each viewpoint, then their number, int64, shape (n + 1,).
        neighbours: viewpoints at the other ends, ascending, int32, shape (edges,).
        lengths: of the ways there, metres, rounded to single precision, float64, same shape.
    """

    mapper: Mapper
    positions: NDArray[np.float64]
    points: NDArray[np.float64]
    pointer: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    lengths: NDArray[np.float64]

    @classmethod
    def build(cls, world: GridMap, mapping: MappingConfig) -> TrueGraph:
        """Map a world as a robot would that knows it.

        Args:
            world: the true map.
            mapping: cells, spacing and the robot's radius.

        Raises:
            MapError: the robot does not fit at the start.
        """
        (x, y), (width, height) = world.origin, world.size
        mapper = Mapper(
            mapping,
            lattice_origin=world.lattice_origin,
            bounds=(x, y, x + width, y + height),
            target=world.target,
        )
        # With the wall around it: what lies outside a world counts as occupied, and to a mapper as unknown.
        resolution = mapping.resolution
        cells = np.pad(known_cells(world, resolution), 1, constant_values=OCCUPIED)
        mapper.belief.assign(cells, (x - resolution, y - resolution))
        mapper.update(Pose(*world.start))
        if mapper.stuck:
            raise MapError(
                f"map {world.name!r}: no viewpoint can be reached from the start {world.start} by a robot of radius "
                f"{mapping.robot_radius:g} m: move the start, or use a smaller mapping.robot_radius"
            )
        edges = mapper.adjacency
        needed = _needed(edges.pointer, edges.neighbours, edges.lengths)
        pointer = np.concatenate([[0], np.cumsum(needed)])[edges.pointer]
        positions = mapper.viewpoints
        points = np.ascontiguousarray((positions - world.origin) / world.resolution)
        # Equally long tours are told apart by rounding: single precision makes the published labels and routes again.
        lengths = edges.lengths[needed].astype(np.float32).astype(np.float64)
        return cls(mapper, positions, points, pointer, edges.neighbours[needed], lengths)

    def __len__(self) -> int:
        return len(self.positions)

    def distances(self) -> NDArray[np.float32]:
        """Return the distances between all viewpoints over edges, metres, float32, shape (n, n)."""
        distances: NDArray[np.float32] = _all_distances(self.pointer, self.neighbours, self.lengths)
        return distances

    def distances_from(self, node: int) -> NDArray[np.float64]:
        """Return the distances of all viewpoints from one, metres, float64, shape (n,)."""
        distances: NDArray[np.float64] = shortest_paths(self.pointer, self.neighbours, self.lengths, node, -1)[0]
        return distances

    def target_links(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the viewpoints from which a way leads straight or inside their piece to the world's target.

        Returns:
            Node numbers, ascending, int64, and metres, float64, both of shape (links,); empty where no way leads there.
        """
        if not self.mapper.target_known:
            return np.empty(0, dtype=np.int64), np.empty(0)
        links = self.mapper.observe().target_links.astype(np.int64)
        lengths = [self.way_length(int(link), len(self)) for link in links]
        return links, np.array(lengths)

    def distances_to_target(self) -> NDArray[np.float64]:
        """Return the distances of all viewpoints to the world's target, metres, shape (n,), inf without a way."""
        links, lengths = self.target_links()
        # The target as one more node, from which edges lead to its links alone.
        pointer = np.append(self.pointer, len(self.neighbours) + len(links))
        neighbours = np.concatenate([self.neighbours, links.astype(np.int32)])
        to_target, _ = shortest_paths(pointer, neighbours, np.concatenate([self.lengths, lengths]), len(self), -1)
        return np.asarray(to_target[:-1])

    def way_length(self, a: int, b: int) -> float:
        """Return the length of the way from a viewpoint to a neighbour, or to the target (number n), metres."""
        corners = np.array([self.mapper.position(a), *self.mapper.way(a, b)])
        return float(np.hypot(*np.diff(corners, axis=0).T).sum())

    def match(self, positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Find the viewpoint whose piece of clear space holds each position.

        While a lattice square is only partly known, the robot's viewpoints in it may be pieces of what is truly one and
        lie elsewhere in it.

        Args:
            positions: metres, shape (m, 2).

        Returns:
            Viewpoint numbers, -1 without one, int64, shape (m,); and the places of these viewpoints, metres, float64,
            shape (m, 2), the positions themselves without one.
        """
        nodes = self.mapper.nodes_at(positions)
        return nodes, np.where(nodes[:, None] >= 0, self.positions[nodes], positions)

"""The viewpoint graph at a wider spacing, for a policy that was trained on wider viewpoints than the robot needs.

Narrow places need viewpoints close together, or no lattice point lies behind a door. A policy reads its world in
lattice steps, so on such a lattice all is farther, wider and more finely divided than anything that it was trained on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.mapping.mapper import Mapper
from common.mapping.sight import CLEAR, blocker
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, Observation
from common.observation_index import NEIGHBOUR_BITS

_MARGIN: Final = 2


@dataclass(frozen=True, slots=True, eq=False)
class CoarseGraph:
    """Some of the mapper's viewpoints as a graph of their own.

    Attributes:
        observation: as `Mapper.observe` gives it, in steps of the coarser lattice.
        nodes: the mapper's node number of each node, the target's included, int64, shape (nodes,).
    """

    observation: Observation
    nodes: NDArray[np.int64]


def coarse_graph(mapper: Mapper, factor: int) -> CoarseGraph:
    """Return the graph of the last update as of viewpoints `factor` times as far apart.

    The viewpoints are parted into squares of `factor` by `factor`, the robot's in the middle of its own. One stands
    for each square: the robot's, else the one that observes most frontiers, else the one nearest to the middle. Two
    of them are joined where edges of the mapper would be, among the 20 neighbours in a straight free line; what this
    leaves cut off is joined along its shortest path to the robot. A square has a beacon, a visit or a link to the
    target where one of its viewpoints has.

    Args:
        mapper: updated, and not stuck.
        factor: how many times as far, at least 1, which gives the mapper's own graph.

    Raises:
        MappingError: the mapper has nothing to observe.
    """
    fine = mapper.observe()
    if factor == 1:
        return CoarseGraph(fine, np.arange(fine.nodes))
    squares = (fine.offsets.astype(np.int64) + factor // 2) // factor
    corner = squares.min(axis=0) - _MARGIN
    columns, rows = squares.max(axis=0) + _MARGIN + 1 - corner
    place = (squares[:, 1] - corner[1]) * columns + squares[:, 0] - corner[0]
    off_centre = np.hypot(*(fine.offsets - factor * squares).T)
    not_robot = np.arange(fine.viewpoints) != fine.robot
    order = np.lexsort((off_centre, -fine.utility.astype(np.int64), not_robot, place))
    places, first = np.unique(place[order], return_index=True)
    nodes = order[first]
    numbers = np.full(rows * columns, -1, dtype=np.int64)
    numbers[places] = np.arange(len(nodes))
    owner = numbers[place]
    subcells = np.array([mapper.belief.subcells(mapper.position(node)) for node in nodes.tolist()], dtype=np.int64)
    cells = mapper.belief.padded
    edges = _join(cells.reshape(-1), cells.shape[1], subcells, places, numbers, columns)
    distances, before = mapper.shortest_paths(fine.robot)
    _connect(edges, places, numbers, columns, nodes, np.argsort(distances[nodes], kind="stable"), owner, before)
    visited, beacon = np.zeros((2, len(nodes)), dtype=np.bool_)
    visited[owner[fine.visited]] = True
    beacon[owner[fine.beacon]] = True
    observation = Observation(
        offsets=squares[nodes].astype(np.int16),
        utility=fine.utility[nodes],
        visited=visited,
        beacon=beacon,
        edges=edges,
        robot=int(owner[fine.robot]),
        has_target=fine.has_target,
        target_known=fine.target_known,
        target_offset=fine.target_offset / np.float32(factor),
        target_links=np.unique(owner[fine.target_links]).astype(np.uint16),
    )
    return CoarseGraph(observation, np.append(nodes, fine.viewpoints) if fine.has_target else nodes)


@njit(cache=True, nogil=True)
def _join(
    cells: NDArray[np.int8],
    width: int,
    subcells: NDArray[np.int64],
    places: NDArray[np.int64],
    numbers: NDArray[np.int64],
    columns: int,
) -> NDArray[np.uint32]:
    """Return the edge masks of the viewpoints that stand for squares: their free lines of sight."""
    edges = np.zeros(len(places), dtype=np.uint32)
    for node in range(len(places)):
        # The second half of the bits names each pair once.
        for bit in range(NEIGHBOUR_COUNT // 2, NEIGHBOUR_COUNT):
            dx, dy = NEIGHBOUR_OFFSETS[bit, 0], NEIGHBOUR_OFFSETS[bit, 1]
            other = numbers[places[node] + dy * columns + dx]
            if other < 0:
                continue
            a, b = subcells[node], subcells[other]
            if blocker(cells, width, a[0], a[1], b[0], b[1]) == CLEAR:
                edges[node] |= np.uint32(1) << np.uint32(bit)
                edges[other] |= np.uint32(1) << np.uint32(NEIGHBOUR_COUNT - 1 - bit)
    return edges


@njit(cache=True, nogil=True)
def _connect(
    edges: NDArray[np.uint32],
    places: NDArray[np.int64],
    numbers: NDArray[np.int64],
    columns: int,
    nodes: NDArray[np.int64],
    nearest_first: NDArray[np.int64],
    owner: NDArray[np.int64],
    before: NDArray[np.int32],
) -> None:
    """Join every square that is cut off from the robot's to those along its shortest path, in place."""
    reached = np.zeros(len(nodes), dtype=np.bool_)
    _flood(edges, places, numbers, columns, nearest_first[0], reached)
    for square in nearest_first:
        last, node = square, nodes[square]
        while not reached[last]:
            node = before[node]
            here = owner[node]
            if here == last:
                continue
            # One edge of the mapper's graph never leads farther than to a square beside.
            dy = places[here] // columns - places[last] // columns
            dx = places[here] % columns - places[last] % columns
            bit = NEIGHBOUR_BITS[dy + 2, dx + 2]
            edges[last] |= np.uint32(1) << np.uint32(bit)
            edges[here] |= np.uint32(1) << np.uint32(NEIGHBOUR_COUNT - 1 - bit)
            last = here
        if not reached[square]:
            _flood(edges, places, numbers, columns, last, reached)


@njit(cache=True, nogil=True)
def _flood(
    edges: NDArray[np.uint32],
    places: NDArray[np.int64],
    numbers: NDArray[np.int64],
    columns: int,
    start: int,
    reached: NDArray[np.bool_],
) -> None:
    """Mark all that is joined to a square, in place; it may be marked itself."""
    reached[start] = True
    stack = [start]
    while stack:
        node = stack.pop()
        for bit in range(NEIGHBOUR_COUNT):
            if (edges[node] >> np.uint32(bit)) & np.uint32(1):
                dx, dy = NEIGHBOUR_OFFSETS[bit, 0], NEIGHBOUR_OFFSETS[bit, 1]
                other = numbers[places[node] + dy * columns + dx]
                if not reached[other]:
                    reached[other] = True
                    stack.append(other)

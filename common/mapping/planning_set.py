"""From the graph to the arrays of an observation: offsets, planning set and edges of the numbered viewpoints."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.mapping.adjacency import Adjacency
from common.mapping.beacons import find_beacons
from common.mapping.raycast import SUBCELLS
from common.mapping.squares import Layout
from common.observations.observation import MAX_DEGREE, MAX_OFFSET, STEP_UNITS
from common.system.jit import njit


class Frame(NamedTuple):
    """Where squares and cells lie in the map frame.

    Attributes:
        lattice_x: x of the lattice's origin, metres.
        lattice_y: y of it.
        first_i: number of the first column of squares.
        first_j: number of the first row of squares.
        spacing: side of the squares, metres.
        x: of the lower left corner of the belief's grid, metres.
        y: of it.
        resolution: metres per cell.
    """

    lattice_x: float
    lattice_y: float
    first_i: int
    first_j: int
    spacing: float
    x: float
    y: float
    resolution: float


@njit(cache=True, nogil=True)
def _gather(
    order: NDArray[np.int32],
    pieces: Any,
    layout: Layout,
    counts: NDArray[np.int32],
    min_utility: int,
    least_utility: int,
    robot: int,
    frame: Frame,
) -> tuple[
    NDArray[np.int64],
    NDArray[np.int64],
    NDArray[np.float64],
    NDArray[np.int16],
    NDArray[np.uint16],
    NDArray[np.bool_],
    np.int64,
]:
    """Return x and y, positions, offsets, utilities and visited flags as in `PlanningSet`, and the largest offset."""
    n = len(order)
    columns = len(layout.x)
    x = np.empty(n, dtype=np.int64)
    y = np.empty(n, dtype=np.int64)
    positions = np.empty((n, 2))
    places = np.empty((n, 2), dtype=np.int64)
    offsets = np.empty((n, 2), dtype=np.int16)
    utility = np.empty(n, dtype=np.uint16)
    visited = np.empty(n, dtype=np.bool_)
    most = 0
    for node in range(n):
        most = max(most, counts[order[node]])
    threshold = min_utility if most >= min_utility else min(least_utility, min_utility)
    for node in range(n):
        p = pieces[order[node]]
        x[node], y[node] = p.x, p.y
        if p.centred and not p.lookout:
            # Exactly the lattice point, without the rounding to subcells.
            positions[node, 0] = frame.lattice_x + (frame.first_i + p.square % columns) * frame.spacing
            positions[node, 1] = frame.lattice_y + (frame.first_j + p.square // columns) * frame.spacing
        else:
            positions[node, 0] = frame.x + (p.x / SUBCELLS - 1.0) * frame.resolution
            positions[node, 1] = frame.y + (p.y / SUBCELLS - 1.0) * frame.resolution
        # Rounded on the lattice, so that differences do not depend on where the robot is.
        scale = STEP_UNITS * frame.resolution / (frame.spacing * SUBCELLS)
        places[node, 0] = np.rint((p.x - layout.x[0]) * scale)
        places[node, 1] = np.rint((p.y - layout.y[0]) * scale)
        count = counts[order[node]]
        # A lookout is one because it is worth a look.
        useful = count >= threshold or (p.lookout and count > 0)
        utility[node] = min(count, 65535) if useful else 0
        visited[node] = p.visited and not p.lookout
    farthest = np.int64(0)
    for node in range(n):
        for axis in range(2):
            away = places[node, axis] - places[robot, axis]
            farthest = max(farthest, abs(away))
            offsets[node, axis] = away
    return x, y, positions, offsets, utility, visited, farthest


@njit(cache=True, nogil=True)
def anything_left(order: NDArray[np.int32], pieces: Any, counts: NDArray[np.int32], least_utility: int) -> bool:
    """Whether one of the viewpoints where the robot has not been observes enough frontiers."""
    for piece in order:
        p = pieces[piece]
        if counts[piece] >= least_utility and (not p.visited or p.lookout):
            return True
    return False


@njit(cache=True, nogil=True)
def _sparse_edges(
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    bent: NDArray[np.bool_],
    spacing: float,
) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.uint32], NDArray[np.float32], np.int64]:
    """Return the edges as an observation lists them, and the largest number of neighbours."""
    n = len(pointer) - 1
    degree = np.zeros(n, dtype=np.uint8)
    half = len(neighbours) // 2
    higher = np.empty(half, dtype=np.uint16)
    is_bent = 0
    for k in range(len(bent)):
        is_bent += bent[k]
    bent_edges = np.empty(is_bent // 2, dtype=np.uint32)
    bent_lengths = np.empty(is_bent // 2, dtype=np.float32)
    at = 0
    count = 0
    most = np.int64(0)
    for node in range(n):
        most = max(most, pointer[node + 1] - pointer[node])
        for k in range(pointer[node], pointer[node + 1]):
            if neighbours[k] > node:
                if bent[k]:
                    bent_edges[count] = at
                    bent_lengths[count] = lengths[k] / spacing
                    count += 1
                higher[at] = neighbours[k]
                at += 1
                degree[node] += 1
    return degree, higher, bent_edges, bent_lengths, most


@njit(cache=True, nogil=True)
def _plan(
    order: NDArray[np.int32],
    pieces: Any,
    layout: Layout,
    counts: NDArray[np.int32],
    min_utility: int,
    least_utility: int,
    robot: int,
    frame: Frame,
    cells: NDArray[np.int8],
    beacon_reach: int,
    pointer: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    lengths: NDArray[np.float64],
    bent: NDArray[np.bool_],
) -> Any:
    """Do all of `plan` in one call: handing arrays over takes as long as the work on them."""
    x, y, positions, offsets, utility, visited, farthest = _gather(
        order, pieces, layout, counts, min_utility, least_utility, robot, frame
    )
    beacon = find_beacons(cells.reshape(-1), cells.shape[1], x, y, utility > 0, beacon_reach)
    degree, higher, bent_edges, bent_lengths, most = _sparse_edges(pointer, neighbours, lengths, bent, frame.spacing)
    return (
        (x, y, positions, offsets, utility, visited, beacon, degree, higher, bent_edges, bent_lengths), farthest, most,
    )  # fmt: skip


class PlanningSet(NamedTuple):
    """What is known of the viewpoints in node order; arrays as `Observation` describes them where it has them.

    Attributes:
        x: subcells of the padded grid, int64, shape (n,).
        y: likewise.
        positions: metres, shape (n, 2).
        offsets: from the robot's viewpoint, 1/64 lattice steps.
        utility: observable frontiers.
        visited: the robot has been there.
        beacon: see `find_beacons`.
        degree: higher neighbours of each node.
        neighbours: those.
        bent: which of the edges are not straight.
        bent_length: of these, lattice steps.
    """

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    positions: NDArray[np.float64]
    offsets: NDArray[np.int16]
    utility: NDArray[np.uint16]
    visited: NDArray[np.bool_]
    beacon: NDArray[np.bool_]
    degree: NDArray[np.uint8]
    neighbours: NDArray[np.uint16]
    bent: NDArray[np.uint32]
    bent_length: NDArray[np.float32]


def plan(
    order: NDArray[np.int32],
    pieces: NDArray[Any],
    layout: Layout,
    counts: NDArray[np.int32],
    min_utility: int,
    least_utility: int,
    robot: int,
    frame: Frame,
    cells: NDArray[np.int8],
    beacon_reach: int,
    edges: Adjacency,
) -> PlanningSet:
    """Collect the planning set of the viewpoints in node order, choose the beacons, and list the edges.

    Args:
        order: piece of each node, int32, shape (n,).
        pieces: all pieces.
        layout: of the squares.
        counts: observable frontiers of each piece's viewpoint.
        min_utility: a viewpoint that observes fewer counts as useless, as long as another observes so many; lookouts
            are always useful.
        least_utility: likewise when none does.
        robot: node number of the robot's viewpoint.
        frame: where squares and cells lie.
        cells: padded grid of the belief, int8, shape (height, width).
        beacon_reach: d_th, subcells.
        edges: of the numbered viewpoints.

    Raises:
        MappingError: a viewpoint is too far away for an observation, or has more neighbours than it can list.
    """
    columns, farthest, most = _plan(
        order, pieces, layout, counts, min_utility, least_utility, robot, frame, cells, beacon_reach,
        edges.pointer, edges.neighbours, edges.lengths, edges.bent,
    )  # fmt: skip
    if farthest > MAX_OFFSET * STEP_UNITS:
        raise MappingError(
            f"a viewpoint is more than {MAX_OFFSET} lattice steps from the robot, the limit of an observation: raise "
            "mapping.viewpoint_spacing"
        )
    if most > MAX_DEGREE:
        raise MappingError(
            f"a viewpoint has {most} neighbours, an observation lists {MAX_DEGREE}: use a smaller "
            "mapping.viewpoint_spacing, or coarser cells"
        )
    return PlanningSet(*columns)

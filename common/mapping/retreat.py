"""Back from clear space that the map cuts off, along the robot's own track."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common.mapping.map_view import MapView
from common.mapping.planning_set import anything_left
from common.mapping.sight import CLEAR, blocker
from common.mapping.track import Track
from common.mapping.viewpoints import ViewpointGraph


@dataclass(frozen=True, slots=True)
class WayBack:
    """A stretch of a track, by indices of its places.

    Attributes:
        oldest: where it ends, cut off from the robot.
        newest: where the robot can get to it: the first such place after the oldest, of the last one if there is none.
        closed: something stands in the way by now.
    """

    oldest: int
    newest: int
    closed: bool


def find_back(
    graph: ViewpointGraph,
    places: NDArray[np.int64],
    numbers: NDArray[np.int32],
    counts: NDArray[np.int32],
    least_utility: int,
    target: int,
) -> WayBack | None:
    """Find the newest place of a track that is cut off from the robot and from where something is left to see.

    Args:
        graph: of the last update.
        places: x and y of the track, oldest first, subcells, int64, shape (2, n).
        numbers: node of each piece where the robot can get to now, -1 without one, int32.
        counts: frontiers that the viewpoint of each piece observes, int32.
        least_utility: so many of them make a viewpoint worth a visit.
        target: piece of the navigation target, which counts as left to see; -1 for none.

    Returns:
        An open way to the newest of those places that have one, else a closed one to the newest; None without a place.
    """
    pieces = graph.pieces_at(*places)
    seen: NDArray[np.bool_] = np.zeros(graph.used, dtype=np.bool_)
    closed = None
    for k in np.flatnonzero((pieces >= 0) & (numbers[pieces] < 0))[::-1].tolist():
        piece = int(pieces[k])
        if seen[piece] or not graph.pieces[piece]["exists"]:
            continue
        order, others, _ = graph.reachable(piece)
        seen[order] = True
        # The robot has seen what there is to see from the only viewpoint of a nook where it has been.
        if len(order) < 2 or others[graph.robot] >= 0:
            continue
        if anything_left(order, graph.pieces, counts, least_utility) or (target >= 0 and others[target] >= 0):
            later = pieces[k:]
            inside = np.flatnonzero((later >= 0) & (numbers[later] >= 0))
            newest = k + int(inside[0]) if len(inside) else len(pieces) - 1
            found = WayBack(k, newest, closed=not _is_free(graph, places[:, k : newest + 1]))
            if not found.closed:
                return found
            closed = closed or found
    return closed


def _is_free(graph: ViewpointGraph, places: NDArray[np.int64]) -> bool:
    """Whether the middle of the robot can still pass along places, subcells, shape (2, n), by what is known."""
    cells = graph.cells
    points = places.T.tolist()
    return all(blocker(cells.belief, cells.width, *a, *b) == CLEAR for a, b in pairwise([points[0], *points]))


def corners_back(view: MapView, position: tuple[float, float], track: Track, way: WayBack) -> list[tuple[float, float]]:
    """Return the corners of the way over edges to a stretch of a track, and back along it, metres.

    Args:
        view: of where the robot can get to now.
        position: of the robot, metres.
        track: of the robot.
        way: the stretch.
    """
    along = track.back(way.newest, way.oldest)
    node = int(view.nodes_at(np.array(along[:1]))[0])
    if node < 0 or view.segment_free(position, along[0]):
        return along
    corners = []
    if node != view.robot:
        corners = view.way_home()
        for a, b in pairwise(view.path(view.robot, node)):
            corners += view.way(a, b)
    return [*corners, *view.way_inside(node, corners[-1] if corners else position, along[0]), *along[1:]]

"""What the planner sees, as markers for RViz and Foxglove."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common import palette
from common.mapping.mapper import Mapper
from common.planners.base import Planner
from common.planners.learned import LearnedPlanner
from deploy.bridge.outcome import Outcome
from deploy.ros2 import Message
from deploy.ros2.markers import Colour, clear, cubes, lines, markers, spheres

# Of more edges than this the shortest are drawn: building markers must not delay decisions.
_MAX_EDGES: Final = 2000
_MAX_FRONTIERS: Final = 4000

# RViz and Foxglove draw on a dark ground.
_EDGE: Final[Colour] = palette.EDGE.rgba_on_dark(0.5)
_VISITED: Final[Colour] = palette.VISITED.rgba_on_dark(0.9)
_PLAIN: Final[Colour] = palette.VIEWPOINT.rgba_on_dark(0.9)
_USEFUL: Final[Colour] = palette.USEFUL.rgba_on_dark(1.0)
_FRONTIER: Final[Colour] = palette.FRONTIER.rgba_on_dark(0.8)
_BEACON: Final[Colour] = palette.BEACON.rgba_on_dark(0.9)
_BANNED: Final[Colour] = palette.BANNED.rgba_on_dark(0.7)
_WAYPOINT: Final[Colour] = palette.WAYPOINT.rgba_on_dark(1.0)


def draw(outcome: Outcome, planner: Planner, stamp: float, frame: str, spacing: float) -> Message | None:
    """Build a MarkerArray of graph, frontiers, beacons, attention, bans and waypoint; None while there is no map.

    Args:
        outcome: of this pass of the decision loop; its mapper is read.
        planner: in charge; a learned one also tells the probabilities of its choices, drawn as opacity.
        stamp: robot time, seconds.
        frame: map frame.
        spacing: between viewpoints, metres.
    """
    mapper = outcome.mapper
    if mapper is None:
        return None
    size = spacing / 5.0
    parts = [clear(stamp, frame)]

    def dots(name: str, positions: NDArray[np.float64], diameter: float, colour: Colour, **more: object) -> None:
        if len(positions):
            parts.append(spheres(stamp, frame, name, positions, diameter, colour, **more))  # type: ignore[arg-type]

    viewpoints = mapper.viewpoints
    if not mapper.stuck:
        observation = mapper.observe()
        parts.append(lines(stamp, frame, "edges", edge_segments(mapper), size / 8.0, _EDGE))
        useful, visited = observation.utility > 0, observation.visited
        dots("viewpoints", viewpoints[~useful & ~visited], size / 1.5, _PLAIN)
        dots("visited", viewpoints[visited & ~useful], size / 1.5, _VISITED)
        dots("useful", viewpoints[useful], size, _USEFUL)
        dots("beacons", mapper.beacons, 2.0 * size, _BEACON)
    frontiers = thinned_frontiers(mapper)
    if len(frontiers):
        parts.append(cubes(stamp, frame, "frontiers", frontiers, mapper.belief.resolution, _FRONTIER))
    if isinstance(planner, LearnedPlanner) and planner.attention is not None and outcome.course is not None:
        seen = planner.attention
        dots("waypoint attention", seen.waypoints, 1.5 * size, _WAYPOINT, **_opacity(seen.waypoint_probabilities))
        dots("beacon attention", seen.beacons, 3.0 * size, _BEACON, **_opacity(seen.beacon_probabilities))
    dots("banned", np.array(outcome.bans, dtype=np.float64).reshape(-1, 2), 1.5 * size, _BANNED)
    if outcome.course is not None:
        dots("waypoint", np.array([outcome.course.waypoint]), 2.0 * size, _WAYPOINT)
    return markers(parts)


def thinned_frontiers(mapper: Mapper) -> NDArray[np.float64]:
    """Return the frontiers, metres, shape (n, 2); of very many, evenly chosen ones."""
    frontiers: NDArray[np.float64] = mapper.frontiers
    return frontiers[:: len(frontiers) // _MAX_FRONTIERS + 1]


def edge_segments(mapper: Mapper) -> NDArray[np.float64]:
    """Return what edges look like, metres, shape (n, 2, 2): the shortest of very many, bent ones by their corners."""
    adjacency = mapper.adjacency
    begin = np.repeat(np.arange(len(adjacency.pointer) - 1), np.diff(adjacency.pointer))
    once = np.flatnonzero(begin < adjacency.neighbours)
    if len(once) > _MAX_EDGES:
        once = once[np.argpartition(adjacency.lengths[once], _MAX_EDGES)[:_MAX_EDGES]]
    bent = adjacency.bent[once]
    viewpoints = mapper.viewpoints
    straight = np.stack([begin[once[~bent]], adjacency.neighbours[once[~bent]]], axis=1)
    corners = [
        pair
        for a, b in zip(begin[once[bent]].tolist(), adjacency.neighbours[once[bent]].tolist(), strict=True)
        for pair in pairwise([mapper.position(a), *mapper.way(a, b)])
    ]
    return np.concatenate([viewpoints[straight].reshape(-1, 2, 2), np.array(corners).reshape(-1, 2, 2)])


def _opacity(probabilities: NDArray[np.float32]) -> dict[str, object]:
    strength = probabilities / max(float(probabilities.max(initial=0.0)), 1e-6)
    red, green, blue, _ = palette.ATTENTION.rgba_on_dark()
    return {"colours": [(red, green, blue, 0.1 + 0.9 * float(value)) for value in strength]}

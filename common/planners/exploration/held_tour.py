"""A tour that is kept while nothing new is seen, so that replanning at each viewpoint comes to an end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.mapping.mapper import Mapper
from common.planners.base import Position
from common.planners.visited_places import PlacesSinceGain


class HeldTour:
    """Ends cycles of a planner that solves its tour again at each viewpoint.

    Such a tour need not be the shortest one: from one viewpoint it may begin with another one's surroundings, and from
    there with the first one's, for ever. A robot that comes back to a viewpoint and has seen nothing new since it
    planned there keeps the tour that it plans now, stop by stop, until it sees something new or the tour ends. Every
    tour kept leads to a stop that is done with afterwards, so there is an end.
    """

    def __init__(self) -> None:
        self._planned = PlacesSinceGain()
        self._stops: list[Position] = []

    def stops(
        self,
        mapper: Mapper,
        candidates: NDArray[np.int64],
        positions: NDArray[np.float64],
        plan: Callable[[], list[int]],
    ) -> list[int]:
        """Return the nodes to visit, those of the tour that is kept or of a new one.

        Args:
            mapper: updated at the robot's pose.
            candidates: nodes that are worth a visit.
            positions: of all viewpoints, metres, shape (n, 2).
            plan: solves a tour.
        """
        if self._planned.forget_on_gain(mapper):
            self._stops.clear()
        if self._stops:
            nodes = {_place(positions[node]): int(node) for node in candidates}
            self._stops = [place for place in self._stops if place in nodes]
            if self._stops:
                return [nodes[place] for place in self._stops]
        tour = plan()
        here = mapper.position(mapper.robot)
        if here in self._planned:
            self._stops = [_place(positions[node]) for node in tour]
        self._planned.add(here)
        return tour


def _place(position: NDArray[np.float64]) -> Position:
    """Return a viewpoint's position without the last digits, which may differ between updates."""
    return round(float(position[0]), 3), round(float(position[1]), 3)

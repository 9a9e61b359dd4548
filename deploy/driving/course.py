"""Where to steer: along the path, or on a way around what blocks it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

from deploy.driving.costmap import LocalCostmap
from deploy.driving.pursuit import PathTracker, Position
from deploy.driving.search import find_way

_PATH_STEP: Final = 0.1
_SEARCH_PERIOD: Final = 0.5
# Another way must be so much shorter to be taken instead of the one begun: two ways of about the same length would
# otherwise take turns while the robot turns to and fro between them.
_SHORTER: Final = 0.8
_LOST: Final = 0.6
_BEGIN: Final = 6


@dataclass(frozen=True, slots=True)
class Course:
    """Where to steer.

    Attributes:
        carrot: (x, y) of the point to steer for, metres, to which a straight line is free as far as one is; None when
            no way leads on.
        remaining: metres to the end of the path.
    """

    carrot: Position | None
    remaining: float


@dataclass(frozen=True, slots=True)
class _Way:
    """A way around.

    Attributes:
        places: from the robot on, metres.
        beyond: metres of path from its end to the path's end.
    """

    places: list[Position]
    beyond: float

    @property
    def remaining(self) -> float:
        return self.beyond + sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(self.places))


class CourseFinder:
    """Finds the course; it looks over the whole local map, so that it does not steer into a dead end that it sees."""

    def __init__(self, costmap: LocalCostmap) -> None:
        self._costmap = costmap
        self._way: _Way | None = None
        self._searched = -np.inf

    def forget(self) -> None:
        """Forget the way that was begun."""
        self._way = None
        self._searched = -np.inf

    def find(self, position: Position, path: PathTracker, reach: float, now: float) -> Course:
        """Steer for the path itself where it is free as far as the local map goes, else for a way around.

        Args:
            position: of the robot, (x, y) metres.
            path: to follow.
            reach: metres ahead at which to steer.
            now: seconds.
        """
        costmap = self._costmap
        along, aside = path.advance(*position)
        remaining = path.length - along + aside
        distances = np.append(np.arange(_PATH_STEP, remaining, _PATH_STEP), remaining)
        places = path.ahead(*position, distances)
        inside = costmap.contains(places)
        known = len(inside) if inside.all() else int(np.argmin(inside))
        distances, places = distances[:known], places[:known]
        blocked = costmap.distances(places) < costmap.passage
        if blocked.any():
            first = int(np.argmax(blocked))
            free = np.flatnonzero(~blocked[first:]) + first
            # Join the path behind all that blocks it; if that cannot be reached, behind the first of it.
            last = len(blocked) - int(np.argmax(blocked[::-1]))
            ends = [
                (places[index], remaining - float(distances[index]))
                for index in (last, *free[:1])
                if index < len(blocked)
            ]
            way = self._around(position, ends, now)
            if way is not None:
                return Course(self._ahead(way, reach), way.remaining)
            # Come closer: from there it may look different.
            distances, places = distances[:first], places[:first]
        for part in (1.0, 0.7, 0.4):
            index = min(int(np.searchsorted(distances, part * reach)), len(distances) - 1)
            if index >= 0 and costmap.free_line(position, _position(places[index])):
                if not blocked.any():
                    self.forget()
                return Course(_position(places[index]), remaining)
        # The path is free, but the robot stands where no straight line leads to it.
        near = slice(min(len(places), round(reach / _PATH_STEP)) - 1, None) if len(places) else slice(0)
        way = self._around(position, [(place, remaining - reach) for place in places[near][:1]], now)
        return Course(None if way is None else self._ahead(way, reach), remaining)

    def _around(self, position: Position, ends: list[tuple[NDArray[np.float64], float]], now: float) -> _Way | None:
        """Keep to the way that was begun while it is free, unless another is much shorter."""
        kept = self._kept(position)
        if (kept is None and self._way is not None) or now - self._searched >= _SEARCH_PERIOD:
            self._searched = now
            for end, beyond in ends:
                places = find_way(self._costmap, position, _position(end))
                if places:
                    new = _Way(places, beyond)
                    if kept is None or new.remaining < _SHORTER * kept.remaining:
                        kept = new
                    break
        self._way = kept
        return kept

    def _kept(self, position: Position) -> _Way | None:
        if self._way is None:
            return None
        places = np.array(self._way.places)
        gaps = np.hypot(places[:, 0] - position[0], places[:, 1] - position[1])
        # Only its begin: the far side of a thin wall is near as well.
        nearest = int(np.argmin(gaps[:_BEGIN]))
        if gaps[nearest] > _LOST:
            return None
        rest = places[nearest + 1 :]
        far = gaps[nearest + 1 :] > self._costmap.room
        # Somewhat less room than a new way needs: measured points tremble.
        room = 2.0 * self._costmap.room - self._costmap.passage
        if (self._costmap.distances(rest[far]) < room).any():
            return None
        if not len(rest):
            return None
        return _Way([position, *map(_position, rest)], self._way.beyond)

    def _ahead(self, way: _Way, reach: float) -> Position:
        """Return the farthest place of a way, up to `reach`, that a straight line leads to."""
        start = way.places[0]
        chosen = None
        for place in way.places[1:]:
            if hypot(place[0] - start[0], place[1] - start[1]) > reach and chosen is not None:
                break
            if self._costmap.free_line(start, place):
                chosen = place
        # In a tight place no line is free by all of the room, and the dynamic window finds what is.
        return chosen or way.places[min(2, len(way.places) - 1)]


def _position(place: NDArray[np.float64]) -> Position:
    return float(place[0]), float(place[1])

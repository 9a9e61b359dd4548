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
_NEXT: Final = 8
_JOINED: Final = 0.4


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
            joints = _joints(blocked, distances >= aside - 1e-9)
            way = self._around(position, [(places[at], remaining - float(distances[at])) for at in joints], now)
            if way is not None:
                return Course(self._ahead(way, reach), way.remaining)
            # Come closer: from there it may look different.
            first = int(np.argmax(blocked))
            distances, places = distances[:first], places[:first]
        for part in (1.0, 0.7, 0.4):
            index = min(int(np.searchsorted(distances, part * reach)), len(distances) - 1)
            if index >= 0 and costmap.free_line(position, _position(places[index])):
                if not blocked.any():
                    self.forget()
                return Course(_position(places[index]), remaining)
        if blocked.any() or not len(places):
            return Course(None, remaining)
        # The path is free, but the robot stands where no straight line leads to it.
        at = min(len(places) - 1, round(reach / _PATH_STEP))
        way = self._around(position, [(places[at], remaining - float(distances[at]))], now)
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
        # The first place is where the robot was.
        places = np.array(self._way.places[1:])
        gaps = np.hypot(places[:, 0] - position[0], places[:, 1] - position[1])
        # Only the next few: the far side of a thin wall is near as well.
        nearest = int(np.argmin(gaps[:_NEXT]))
        if gaps[nearest] > _LOST or gaps[-1] < _JOINED or nearest == len(gaps) - 1:
            return None
        rest = places[nearest + 1 :]
        far = gaps[nearest + 1 :] > self._costmap.room
        # Somewhat less room than a new way needs: measured points tremble.
        room = 2.0 * self._costmap.room - self._costmap.passage
        if (self._costmap.distances(rest[far]) < room).any():
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


def _joints(blocked: NDArray[np.bool_], on_path: NDArray[np.bool_]) -> list[int]:
    """Return where a way around should join the path: behind all that blocks it, else behind the first of it.

    Before the path lies the straight line from the robot to it; that is joined only when nothing else is near.
    """
    first, last = np.flatnonzero(blocked)[[0, -1]]
    index = np.arange(len(blocked))
    free = index[~blocked & (index > first)]
    on_path = on_path[free]
    joints = [*free[on_path & (free > last)][:1], *free[on_path][:1]] or list(free[-1:])
    return list(dict.fromkeys(int(joint) for joint in joints))


def _position(place: NDArray[np.float64]) -> Position:
    return float(place[0]), float(place[1])

"""People in the robot's world: they walk from place to place, and stop before the robot and before one another."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import dist
from typing import Final

import numpy as np

from actors.maps.grid_map import GridMap
from common.errors import MapError
from common.mapping.clearance import CLEAR_CELL
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import OCCUPIED
from common.planners.base import Position
from common.planners.navigation.cell_path import cell_path
from common.planners.navigation.following import along
from common.system.extras import optional

RADIUS: Final = 0.25
"""Of a person, metres."""
HEIGHT: Final = 1.7
"""Of a person, metres."""
# Room that people keep to walls, to the robot and to one another beyond their own size, metres.
_FROM_WALL, _FROM_ROBOT, _FROM_OTHERS = 0.05, 1.0, 0.35
_SPEEDS: Final = (0.6, 1.3)
_STAY: Final = 8.0
"""Mean time at a place, seconds."""
_PATIENCE: Final = 3.0
"""Who has waited for so long goes somewhere else, seconds."""
_FARTHEST: Final = 20.0
"""Places are chosen within this of where a person is, metres, by which choosing takes as long in any world."""
_AWAY: Final = 2.0
"""Nobody begins nearer to the robot, metres."""
_TRIES: Final = 4


@dataclass(slots=True)
class _Person:
    position: Position
    speed: float
    way: list[Position] = field(default_factory=list)
    stays: float = 0.0
    waited: float = 0.0


class People:
    """Discs that walk short ways through free space; the same seed and the same robot give the same people."""

    def __init__(self, world: GridMap, count: int, seed: int) -> None:
        """Put people on places from which the robot's start can be reached.

        Args:
            world: true map.
            count: of people.
            seed: of their places, speeds and times.

        Raises:
            MapError: the world has no room for a person.
            ConfigError: scipy is not installed.
        """
        # It takes a while to import, and most robots are alone.
        with optional("a robot among people", "plots"):
            from scipy import ndimage

        self._world = world
        self._rng = np.random.default_rng([seed, 7])
        room = ndimage.distance_transform_edt(np.pad(world.free, 1))[1:-1, 1:-1] * world.resolution
        clear = room - 0.5 * world.resolution >= RADIUS + _FROM_WALL
        labels, _ = ndimage.label(clear)
        rows, columns = np.nonzero(clear)
        middles = np.column_stack([columns, rows]) * world.resolution + np.array(world.origin) + 0.5 * world.resolution
        gaps = np.hypot(*(middles - np.array(world.start)).T)
        if len(gaps):
            start = int(np.argmin(gaps))
            self._clear = labels == labels[rows[start], columns[start]]
        away = np.flatnonzero(self._clear[rows, columns] & (gaps >= _AWAY)) if len(gaps) else gaps
        if not len(away):
            raise MapError(
                f"{world.name}: there is no room for people of {RADIUS:g} m radius {_AWAY:g} m and more away from the "
                "robot: leave --people out"
            )
        self._people = [
            _Person(self._middle(int(rows[at]), int(columns[at])), float(self._rng.uniform(*_SPEEDS)))
            for at in self._rng.choice(away, size=count)
        ]

    @property
    def positions(self) -> list[Position]:
        """Where they are, metres, map frame."""
        return [person.position for person in self._people]

    def step(self, seconds: float, robot: Position) -> None:
        """Walk on for some seconds; the robot is an obstacle to people as they are to one another."""
        for number, person in enumerate(self._people):
            if person.stays > 0.0:
                person.stays -= seconds
            elif not person.way:
                person.way = self._choose(person.position)
                person.stays = 0.0 if person.way else 1.0
            else:
                self._walk(number, person, seconds, robot)

    def _walk(self, number: int, person: _Person, seconds: float, robot: Position) -> None:
        goal, step = person.way[0], person.speed * seconds
        ahead = goal if dist(person.position, goal) <= step else along(person.position, goal, step)
        # Two who meet must not both wait: who came first goes on, unless the other stands.
        others = [
            (other.position, _FROM_OTHERS + 2.0 * RADIUS)
            for place, other in enumerate(self._people)
            if place < number or (place > number and (other.stays > 0.0 or other.waited > 0.0))
        ]
        if any(_nears(person.position, ahead, *each) for each in [(robot, _FROM_ROBOT + RADIUS), *others]):
            person.waited += seconds
            if person.waited > _PATIENCE:
                person.way, person.waited = [], 0.0
            return
        person.waited = 0.0
        person.position = ahead
        if ahead == goal:
            person.way.pop(0)
            if not person.way:
                person.stays = float(self._rng.exponential(_STAY))

    def _choose(self, position: Position) -> list[Position]:
        """Return the corners of a way to another place; none where none was found near."""
        world = self._world
        row, column = world.cell(position)
        reach = round(_FARTHEST / world.resolution)
        top, left = max(row - reach, 0), max(column - reach, 0)
        window = self._clear[top : row + reach + 1, left : column + reach + 1]
        cells = np.pad(np.where(window, CLEAR_CELL, OCCUPIED).astype(np.int8), 1, constant_values=OCCUPIED)
        width = cells.shape[1]
        start = (row - top + 1) * width + column - left + 1
        places = np.flatnonzero(cells == CLEAR_CELL)
        for goal in self._rng.choice(places, size=_TRIES):
            corners = cell_path(cells, start, int(goal))[1:]
            if len(corners):
                metres = (corners / SUBCELLS - 1.0 + np.array([left, top])) * world.resolution + np.array(world.origin)
                return [(float(x), float(y)) for x, y in metres]
        return []

    def _middle(self, row: int, column: int) -> Position:
        x, y = self._world.origin
        return x + (column + 0.5) * self._world.resolution, y + (row + 0.5) * self._world.resolution


def _nears(here: Position, ahead: Position, other: Position, room: float) -> bool:
    """Whether a step leads nearer to another one than the room between them has to be."""
    gap = dist(ahead, other)
    return gap < room and gap < dist(here, other)

"""What is near the robot: obstacle points, and the distance to the nearest of them on a grid."""

from __future__ import annotations

from math import floor, hypot, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from deploy.config import DrivingConfig

Points = NDArray[np.float64]
Grid = NDArray[np.float64]
_BEYOND_ROOM: Final = 0.3
_THIN: Final = 0.02
# The newest scan has no points nearer than the sensor's least range, and a robot turned away sees none behind it.
_MEMORY_SECONDS: Final = 1.0
_MEMORY_RADIUS: Final = 0.2


class Field(NamedTuple):
    """Distances to the nearest obstacle on a grid; kernels take it as it is.

    Attributes:
        distances: (rows, columns) metres from each cell's centre to the nearest point, at most `cap`.
        left: metres, map frame.
        bottom: metres, map frame.
        resolution: metres.
        cap: metres; distances are exact below it.
    """

    distances: Grid
    left: float
    bottom: float
    resolution: float
    cap: float


class LocalCostmap:
    """Obstacles in a square around the robot.

    Attributes:
        points: (n, 2) obstacle points, metres, map frame, at most one in 2 cm x 2 cm.
        field: distances to them.
        room: distance that the robot's centre keeps from obstacles, metres.
        passage: distance from which on cells belong to a way; a little more, as the robot cuts their corners.
    """

    def __init__(self, config: DrivingConfig) -> None:
        self.room = config.robot_radius + config.clearance
        self.passage = self.room + 0.25 * config.costmap_resolution
        cells = max(3, round(config.costmap_size / config.costmap_resolution))
        cap = self.room + _BEYOND_ROOM
        self.field = Field(np.full((cells, cells), cap), 0.0, 0.0, config.costmap_resolution, cap)
        self.points: Points = np.empty((0, 2))
        self._side = cells * config.costmap_resolution
        self._memory_radius = config.reach + config.clearance + _MEMORY_RADIUS
        self._memory: Points = np.empty((0, 2))
        self._seen: NDArray[np.float64] = np.empty(0)

    def update(self, x: float, y: float, obstacles: Points, now: float) -> None:
        """Take in the obstacles of this moment, around a robot at (x, y), metres; `now` in seconds.

        Obstacles close to the robot are remembered for a second, as sensors do not see what is too near.
        """
        side = self._side
        # Cells stay where they are in the map: a gap that is just wide enough must not come and go with every step.
        left, bottom = (floor((value - side / 2.0) / self.field.resolution) for value in (x, y))
        self.field = self.field._replace(left=left * self.field.resolution, bottom=bottom * self.field.resolution)
        seen = np.ascontiguousarray(obstacles, dtype=np.float64).reshape(-1, 2)
        remembered = self._memory[now - self._seen <= _MEMORY_SECONDS]
        self.points = _thin(np.concatenate((seen, remembered)), self.field.left, self.field.bottom, side, _THIN)
        near = seen[np.hypot(seen[:, 0] - x, seen[:, 1] - y) < self._memory_radius]
        self._memory = np.concatenate((near, remembered))
        self._seen = np.concatenate((np.full(len(near), now), self._seen[now - self._seen <= _MEMORY_SECONDS]))
        _measure(self.field, self.points)

    def forget(self) -> None:
        """Forget what was near before."""
        self._memory = np.empty((0, 2))
        self._seen = np.empty(0)

    def near(self, x: float, y: float, radius: float) -> tuple[Points, NDArray[np.float64]]:
        """Return the points within a radius, and their distances, metres."""
        distances = np.hypot(self.points[:, 0] - x, self.points[:, 1] - y)
        chosen = distances < radius
        return self.points[chosen], distances[chosen]

    def contains(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Say of each position, (n, 2) metres, whether it lies on the grid."""
        offsets = places - (self.field.left, self.field.bottom)
        return np.asarray(((offsets >= 0.0) & (offsets < self._side)).all(axis=1))

    def distances(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return for each position, (n, 2) metres, how far the centre of its cell is from the nearest obstacle."""
        return np.asarray(_distances(self.field, places))

    def free_line(self, start: tuple[float, float], end: tuple[float, float]) -> bool:
        """Whether the robot can go straight from start to end with its room.

        What is nearer than that to the start already must come no nearer.
        """
        return bool(_free_line(self.points, *start, *end, self.room))


@njit(cache=True, nogil=True)
def lookup(field: Field, x: float, y: float) -> float:
    """Return the value of a position's cell; `cap` outside of the grid."""
    column = int(np.floor((x - field.left) / field.resolution))
    row = int(np.floor((y - field.bottom) / field.resolution))
    if row < 0 or column < 0 or row >= field.distances.shape[0] or column >= field.distances.shape[1]:
        return field.cap
    return field.distances[row, column]


@njit(cache=True, nogil=True)
def _distances(field: Field, places: NDArray[np.float64]) -> NDArray[np.float64]:
    values = np.empty(len(places))
    for index in range(len(places)):
        values[index] = lookup(field, places[index, 0], places[index, 1])
    return values


@njit(cache=True, nogil=True)
def _thin(points: Points, left: float, bottom: float, side: float, cell: float) -> Points:
    """Keep the first point in each small cell, and none outside of the square."""
    count = int(side / cell) + 1
    taken = np.zeros((count, count), dtype=np.bool_)
    kept = np.empty((len(points), 2))
    size = 0
    for index in range(len(points)):
        x, y = points[index, 0], points[index, 1]
        if not (left <= x < left + side and bottom <= y < bottom + side):
            continue
        row, column = int((y - bottom) / cell), int((x - left) / cell)
        if not taken[row, column]:
            taken[row, column] = True
            kept[size, 0], kept[size, 1] = x, y
            size += 1
    return kept[:size].copy()


@njit(cache=True, nogil=True)
def _measure(field: Field, points: Points) -> None:
    """Write the distance to the nearest point into all cells within `cap` of any."""
    distances, left, bottom, resolution, cap = field
    distances[:] = cap
    rows, columns = distances.shape
    for index in range(len(points)):
        x, y = points[index, 0], points[index, 1]
        first_row = max(0, int(np.floor((y - cap - bottom) / resolution)))
        last_row = min(rows - 1, int(np.floor((y + cap - bottom) / resolution)))
        first_column = max(0, int(np.floor((x - cap - left) / resolution)))
        last_column = min(columns - 1, int(np.floor((x + cap - left) / resolution)))
        for row in range(first_row, last_row + 1):
            dy = bottom + (row + 0.5) * resolution - y
            for column in range(first_column, last_column + 1):
                dx = left + (column + 0.5) * resolution - x
                distances[row, column] = min(distances[row, column], sqrt(dx * dx + dy * dy))


@njit(cache=True, nogil=True)
def _free_line(points: Points, x0: float, y0: float, x1: float, y1: float, room: float) -> bool:
    dx, dy = x1 - x0, y1 - y0
    length = hypot(dx, dy)
    if length > 0.0:
        dx, dy = dx / length, dy / length
    for index in range(len(points)):
        px, py = points[index, 0] - x0, points[index, 1] - y0
        along = min(max(px * dx + py * dy, 0.0), length)
        if hypot(px - along * dx, py - along * dy) < min(room, hypot(px, py)) - 1e-9:
            return False
    return True
